#!/usr/bin/env bash
# A server and a scene on two machines: network namespaces with a cable (veth) between them.
#
#   tests/tools/two_machines.sh HAPTICD [SECONDS]
#
# The scene knows nothing but the line that `pair` printed. Shows what each transport's scene
# measured; ends with "two machines: all as it should be". Needs root and iproute2; leaves nothing
# behind.
set -euo pipefail

hapticd=$(realpath "$1")
seconds=${2:-5}
server=hapticd-server-$$
client=hapticd-client-$$
work=$(mktemp -d)
pid=

clean_up() {
    if [ -n "$pid" ]; then kill "$pid" 2>/dev/null || true; fi
    wait 2>/dev/null || true
    ip netns del "$server" 2>/dev/null || true
    ip netns del "$client" 2>/dev/null || true
    rm -rf "$work"
}
trap clean_up EXIT

here() { ip netns exec "$server" "$@"; }
there() { ip netns exec "$client" "$@"; }

# refused WORD COMMAND...: it fails and says so
refused() {
    local word=$1
    shift
    if "$@" >"$work/refused" 2>&1; then
        echo "not refused: $*" >&2
        return 1
    fi
    if ! grep -q "$word" "$work/refused"; then
        echo "refused in other words: $*" >&2
        cat "$work/refused" >&2
        return 1
    fi
    echo "refused as it should be: $(tail -n 1 "$work/refused")"
}

ip netns add "$server"
ip netns add "$client"
ip -n "$server" link add cable type veth peer name cable netns "$client"
ip -n "$server" addr add 192.0.2.1/24 dev cable
ip -n "$client" addr add 192.0.2.2/24 dev cable
for machine in "$server" "$client"; do
    ip -n "$machine" link set lo up
    ip -n "$machine" link set cable up
done

refused "nobody has a credential" \
    here "$hapticd" serve --listen 192.0.2.1 --state-dir "$work/state"
connect=$(here "$hapticd" pair anna --role controller --host 192.0.2.1 --state-dir "$work/state" \
    2>"$work/pair.log")
watch=$(here "$hapticd" pair ben --role observer --host 192.0.2.1 --state-dir "$work/state" \
    2>>"$work/pair.log")
# Not by `here`: this has to be the server's own process, to be ended.
ip netns exec "$server" "$hapticd" serve --listen 192.0.2.1 --state-dir "$work/state" \
    >"$work/connect" 2>"$work/serve.log" &
pid=$!
for _ in $(seq 100); do
    if [ -s "$work/connect" ]; then break; fi
    sleep 0.1
done

for transport in quic webtransport udp; do
    there "$hapticd" scene wall --connect "$connect" --transport "$transport" \
        --seconds "$seconds" --json >"$work/scene.json" 2>"$work/scene.log" || {
        cat "$work/scene.log" "$work/serve.log" >&2
        exit 1
    }
    echo "$transport: $(cat "$work/scene.json")"
    python3 - "$work/scene.json" <<'PYTHON'
import json, sys

with open(sys.argv[1]) as file:
    scene = json.load(file)
# Beside what a busy machine leaves out; nothing is lost on a cable.
assert scene["states_ratio"] > 0.9, scene
assert scene["commanded_ratio"] > 0.9, scene
assert scene["touching_ratio"] > 0.1, scene
assert scene["penetration_max_mm"] < 2, scene
PYTHON
done
there "$hapticd" ctl --connect "$watch" state
refused "role = observer" there "$hapticd" ctl --connect "$watch" disable
refused "role = observer" there "$hapticd" scene wall --connect "$watch" --seconds 1
refused "not known here" there "$hapticd" scene wall --connect "${connect}x" --seconds 1
refused "credential is needed" there "$hapticd" scene wall --connect "$(cat "$work/connect")" --seconds 1
there python3 - <<'PYTHON'
import json, ssl, urllib.request

context = ssl._create_unverified_context()
url = "https://192.0.2.1:7354/certificate-hashes"
with urllib.request.urlopen(url, timeout=5, context=context) as answer:
    assert len(json.load(answer)["sha256"]) == 2
for port in (7353, 7350):
    try:
        urllib.request.urlopen(f"http://192.0.2.1:{port}/metrics", timeout=5)
    except OSError as error:
        print(f"plaintext on {port}: {error}")
    else:
        raise SystemExit(f"plaintext is answered on {port}")
PYTHON
here "$hapticd" pair --revoke anna --state-dir "$work/state"
sleep 2
refused "not known here" there "$hapticd" scene wall --connect "$connect" --seconds 1
here "$hapticd" audit --state-dir "$work/state" | tail -n 12
echo "two machines: all as it should be"

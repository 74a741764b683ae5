"""A browser opens WebTransport by certificate hash, gets State and pushes a wall that is felt.

    python3 tests/tools/chromium_webtransport.py HTTP_HOST:PORT [TOKEN]

Needs Chromium on PATH, and a running `hapticd serve` whose simulated hand presses against things at
x = 0.3 m (`--hand press-and-slide`, the default) and that nobody commands. Serves
webtransport.html from this machine, opens it in a headless Chromium with a profile of its own,
and waits for what the page tells. With the TOKEN of a controller, for a server that asks for one,
the page opens its session by grpc-web and joins it with the ticket. Then asks as a stranger's page would, which has to be refused.
Ends with the line "N passed, N failed"; the exit status is 1 where something failed.
"""

import http.server
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import urllib.error
import urllib.request

HERE = os.path.dirname(os.path.abspath(__file__))
PATIENCE_S = 90
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


class Page(http.server.BaseHTTPRequestHandler):
    """Gives the page and takes its result."""

    results = []
    told = threading.Event()

    def do_GET(self):
        with open(os.path.join(HERE, "webtransport.html"), "rb") as file:
            body = file.read()
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_POST(self):
        length = int(self.headers.get("Content-Length", 0))
        Page.results.append(json.loads(self.rfile.read(length)))
        self.send_response(204)
        self.end_headers()
        Page.told.set()

    def log_message(self, *arguments):
        pass


def run_page(chromium, hapticd_http, token):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://localhost:{server.server_port}/?hashes=http://{hapticd_http}/certificate-hashes"
    if token is not None:
        url += f"&token={token}"
    profile = tempfile.mkdtemp()
    with tempfile.TemporaryFile() as log:
        command = [chromium, *FLAGS, f"--user-data-dir={profile}", url]
        browser = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        try:
            if not Page.told.wait(PATIENCE_S):
                log.seek(0)
                tail = log.read().decode(errors="replace").splitlines()[-15:]
                raise AssertionError("the page told nothing; Chromium said:\n" + "\n".join(tail))
        finally:
            # All of its processes: one that goes on writes into the profile.
            os.killpg(browser.pid, signal.SIGKILL)
            browser.wait()
            shutil.rmtree(profile, ignore_errors=True)
    Page.told.clear()
    return Page.results.pop()


def refused(hapticd_http, headers):
    request = urllib.request.Request(f"http://{hapticd_http}/certificate-hashes", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=5) as answer:
            raise AssertionError(f"{headers} got {answer.status}")
    except urllib.error.HTTPError as error:
        assert error.code == 403, error.code


def main():
    if not 2 <= len(sys.argv) <= 3:
        print(__doc__, file=sys.stderr)
        return 2
    hapticd_http = sys.argv[1].removeprefix("http://").removesuffix("/metrics")
    token = sys.argv[2] if len(sys.argv) == 3 else None
    chromium = shutil.which("chromium")
    if not chromium:
        print("no chromium on PATH", file=sys.stderr)
        return 2
    result = {}

    def a_page_feels_its_wall():
        result.update(run_page(chromium, hapticd_http, token))
        print(f"        {json.dumps(result)}")
        assert "error" not in result, result["error"]
        assert result["states"] >= 500, result
        assert 0 < result["depth_m"] < 0.01 and result["requested_n"] < 0, result

    def without_the_token_or_with_a_wrong_one_nothing_opens():
        for wrong in [None, "guessed"] if token is not None else []:
            result = run_page(chromium, hapticd_http, wrong)
            assert "error" in result, result
            print(f"        {result['error']}")

    def a_strangers_page_is_refused():
        refused(hapticd_http, {"Origin": "https://evil.example"})

    def a_name_that_was_made_to_point_here_is_refused():
        refused(hapticd_http, {"Host": f"evil.example:{hapticd_http.rsplit(':', 1)[1]}"})

    passed = failed = 0
    for step in [
        a_page_feels_its_wall,
        without_the_token_or_with_a_wrong_one_nothing_opens,
        a_strangers_page_is_refused,
        a_name_that_was_made_to_point_here_is_refused,
    ]:
        title = step.__name__.replace("_", " ")
        try:
            step()
        except Exception as error:  # a step that breaks in whatever way has failed
            failed += 1
            print(f"FAILED  {title}: {type(error).__name__}: {error}")
        else:
            passed += 1
            print(f"ok      {title}")
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

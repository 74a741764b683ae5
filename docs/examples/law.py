"""A wall law for `hapticd experiment wall-following --law "exec:python3 docs/examples/law.py"`.

Each tick one JSON object on stdin, one on stdout. While the handle slides, the brake with the
least drag of those that push out of the wall carries the hand's press, and a little more where
the handle is deep or still goes in. At rest two brakes hold, balanced so that the one in the way
is at zero just where the handle begins to slide. It needs the hand's force; without a sensor it
believes in a fixed press.
"""

import json
import sys

LAYER_M = 1e-4  # where the handle is to stay
RATE_PER_S = 60.0  # how fast it gets there
PRESS_N = 10.0  # believed without a sensor
SLIDES_M_PER_S = 3e-3  # faster than this it slides


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1]


def least_drag(seen, normal, tangent, way):
    """Drag per newton of press, number and pull of the best brake against sliding in `way`."""
    best = None
    for i, ray in enumerate(seen["reference_N_per_Nm"]):
        pull = dot(ray, normal)
        if abs(pull) < 0.03 * dot(ray, ray) ** 0.5:
            continue
        drag = -way * dot(ray, tangent) / pull
        if drag > 0 and (best is None or drag < best[0]):
            best = (drag, i, abs(pull))
    return best


def law(seen):
    most = seen["max_torque_Nm"]
    capacity = [0.0] * len(most)
    if not seen["walls"]:
        return capacity
    wall = max(seen["walls"], key=lambda wall: wall["depth_m"])
    normal, velocity = wall["normal"], seen["velocity_m_per_s"]
    tangent = [-normal[1], normal[0]]
    mass = seen["inertia_kg"][0][0]
    hand = seen["hand_force_N"] or [-PRESS_N * part for part in normal]
    into, speed = -dot(velocity, normal), dot(velocity, tangent)
    layer = RATE_PER_S**2 * (wall["depth_m"] - LAYER_M) + 2 * RATE_PER_S * into
    force = min(mass * layer - dot(hand, normal), wall["force_N"])
    if force <= 0:
        return capacity
    ahead = least_drag(seen, normal, tangent, 1.0)
    behind = least_drag(seen, normal, tangent, -1.0)
    if not (ahead and behind):
        return most
    if abs(speed) > SLIDES_M_PER_S:
        share = 1.0 if speed > 0 else 0.0
    else:
        along = dot(hand, tangent) / force
        share = (along + behind[0]) / (ahead[0] + behind[0])
        share = min(max(share, 0.0), 1.0)
    for (_, i, pull), part in ((ahead, share), (behind, 1.0 - share)):
        capacity[i] = min(capacity[i] + part * force / pull, most[i])
    return capacity


for line in sys.stdin:
    print(json.dumps({"capacity_Nm": law(json.loads(line))}), flush=True)

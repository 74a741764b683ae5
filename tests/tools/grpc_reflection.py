"""A wall made, moved, felt and deleted over gRPC by a client that knows only reflection.

    python3 tests/tools/grpc_reflection.py HOST:PORT [CONNECT_STRING]

With the connect string of an operator it speaks TLS, after a look at the certificate's hash, and
shows the token. Needs grpcio and grpcio-reflection, and a running `hapticd serve` whose simulated hand presses
against things (`--hand press-and-slide`, the default) and whose scene has no object
"reflected". Nothing here is generated from proto/: services, methods and messages are what
the server says they are. Ends with the line "N passed, N failed"; the exit status is 1 where
something failed.
"""

import hashlib
import math
import os
import ssl
import sys
import time
import urllib.parse

# This file has the name of the package that it uses, and its folder comes first.
HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry) != HERE]

import grpc
from google.protobuf import descriptor_pool, message_factory
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import (
    ProtoReflectionDescriptorDatabase,
)

CALL_TIMEOUT_S = 5
# The hand comes back to the wall every few seconds.
FEEL_TIMEOUT_S = 30
# Tens of newtons into a wall of 20 kN/m, and the handle between two states.
WALL_WIDTH_M = 0.004


def secure(address, connect):
    """TLS to the server of a connect string, known by its hash, with the token on every call."""
    query = urllib.parse.parse_qs(urllib.parse.urlsplit(connect).query)
    host, port = address.rsplit(":", 1)
    pem = ssl.get_server_certificate((host, int(port)))
    found = hashlib.sha256(ssl.PEM_cert_to_DER_cert(pem)).hexdigest()
    assert found == query["sha256"][0], f"another server: {found}"
    credentials = grpc.composite_channel_credentials(
        grpc.ssl_channel_credentials(pem.encode()),
        grpc.access_token_call_credentials(query["token"][0]),
    )
    options = [("grpc.ssl_target_name_override", "hapticd")]
    return grpc.secure_channel(address, credentials, options)


class Server:
    """Calls methods by their full names; requests and answers are built from reflection."""

    def __init__(self, address, connect=None):
        self.channel = secure(address, connect) if connect else grpc.insecure_channel(address)
        self.database = ProtoReflectionDescriptorDatabase(self.channel)
        self.pool = descriptor_pool.DescriptorPool(self.database)

    def services(self):
        return sorted(self.database.get_services())

    def method(self, service, name):
        return self.pool.FindServiceByName(service).FindMethodByName(name)

    def message(self, name, **fields):
        return message_factory.GetMessageClass(self.pool.FindMessageTypeByName(name))(**fields)

    def number(self, enum, name):
        return self.pool.FindEnumTypeByName(enum).values_by_name[name].number

    def call(self, service, name, /, **fields):
        method = self.method(service, name)
        request = message_factory.GetMessageClass(method.input_type)(**fields)
        answer = message_factory.GetMessageClass(method.output_type)
        stub = self.channel.unary_unary(
            f"/{service}/{name}",
            request_serializer=type(request).SerializeToString,
            response_deserializer=answer.FromString,
        )
        return stub(request, timeout=CALL_TIMEOUT_S)


DEVICE_SERVICE = "hapticd.v1.DeviceService"
SCENE_SERVICE = "hapticd.v1.SceneService"


class Walk:
    """The steps, in order; each may use what the ones before it found."""

    def __init__(self, server):
        self.server = server

    def devices(self, method, /, **fields):
        return self.server.call(DEVICE_SERVICE, method, **fields)

    def scenes(self, method, /, **fields):
        return self.server.call(SCENE_SERVICE, method, **fields)

    def wall(self, x_m, stiffness=20_000.0, name=""):
        """A wall whose free side is x < x_m."""
        return {
            "name": name,
            "half_space": {"point_m": {"x": x_m}, "normal": {"x": -1.0}},
            "material": {"stiffness_n_per_m": stiffness, "damping_ns_per_m": 20.0},
        }

    def region(self, name):
        return self.server.number("hapticd.v1.Region", f"REGION_{name}")

    def revision(self):
        return self.scenes("GetScene", name=self.scene).revision

    def refused(self, code, words, method, /, **fields):
        """The call is refused with this status, whose message has all these words."""
        try:
            answer = self.scenes(method, **fields)
        except grpc.RpcError as error:
            assert error.code() == code, f"{error.code()} instead of {code}: {error.details()}"
            missing = [word for word in words if word not in error.details()]
            assert not missing, f"{missing} not in {error.details()!r}"
        else:
            raise AssertionError(f"not refused: {answer}")

    def feel(self, what, wanted):
        """Polls the state until `wanted` holds; returns the state."""
        until = time.monotonic() + FEEL_TIMEOUT_S
        while time.monotonic() < until:
            state = self.devices("GetState", name=self.device)
            if wanted(state):
                return state
            time.sleep(0.005)
        raise AssertionError(f"{what}: not within {FEEL_TIMEOUT_S} s; last state: {state}")

    def touched(self, state):
        return next((c for c in state.contacts if c.name == self.object), None)

    def feel_wall_at(self, x_m):
        """The reported force comes from the wall, out of it, with the handle at its surface.

        A wall that appears around the handle pushes nobody out: it is felt at its place once
        the hand has left it and come back.
        """
        state = self.feel(
            f"a force at x = {x_m} m",
            lambda s: self.touched(s) is not None
            and s.requested.force_n.x < -0.1
            and abs(s.measured_cp.position_m.x - x_m) < WALL_WIDTH_M,
        )
        contact = self.touched(state)
        assert 0.0 < contact.depth_m < WALL_WIDTH_M, contact
        assert 0.1 < contact.normal_n < 1000.0, contact
        assert state.scene_revision == self.revision(), state

    # --- steps ---

    def step_reflection_lists_the_services(self):
        listed = self.server.services()
        wanted = {DEVICE_SERVICE, SCENE_SERVICE, "grpc.health.v1.Health"}
        assert wanted <= set(listed), listed

    def step_reflection_describes_every_method(self):
        for service in (DEVICE_SERVICE, SCENE_SERVICE):
            methods = self.server.pool.FindServiceByName(service).methods
            assert methods, service
            for method in methods:
                assert method.input_type.name == f"{method.name}Request", method.full_name

    def step_the_server_is_healthy(self):
        answer = self.server.call("grpc.health.v1.Health", "Check", service=SCENE_SERVICE)
        assert answer.status == 1, answer

    def step_the_device_is_listed_and_enabled(self):
        answer = self.devices("ListDevices")
        assert len(answer.devices) >= 1, answer
        self.device = answer.devices[0].name
        self.scene = f"{self.device}/scene"
        self.object = f"{self.scene}/objects/reflected"
        enabled = self.server.number("hapticd.v1.Mode", "MODE_ENABLED")
        assert answer.devices[0].mode == enabled, answer

    def step_a_wall_is_created(self):
        before = self.revision()
        made = self.scenes(
            "CreateObject", parent=self.scene, object_id="reflected", object=self.wall(0.3)
        )
        assert made.name == self.object and made.revision == before + 1, made
        assert self.revision() == before + 1

    def step_the_wall_is_felt_where_it_is(self):
        self.feel_wall_at(0.3)

    def step_some_of_the_force_is_rendered(self):
        # A handle at rest has no region (common.proto): the brakes hold it either way.
        state = self.feel(
            "an achievable force on a handle that moves",
            lambda s: math.hypot(s.achievable.force_n.x, s.achievable.force_n.y) > 0.1
            and any(actuator.commanded_nm > 0.0 for actuator in s.actuators)
            and s.region in (self.region("FULL"), self.region("APPROXIMATE")),
        )
        for actuator in state.actuators:
            assert actuator.lower_nm <= actuator.upper_nm, actuator

    def step_the_wall_is_moved_and_read_back(self):
        moved = self.scenes("UpdateObject", object=self.wall(0.31, name=self.object))
        read = self.scenes("GetObject", name=self.object)
        assert read == moved, (read, moved)
        assert read.half_space.point_m.x == 0.31, read

    def step_the_moved_wall_is_felt_at_its_new_place(self):
        self.feel_wall_at(0.31)

    def step_a_list_has_it(self):
        answer = self.scenes("ListObjects", parent=self.scene)
        assert self.object in [listed.name for listed in answer.objects], answer
        assert answer.scene_revision == self.revision()

    def step_a_second_object_of_that_name_is_refused(self):
        self.refused(
            grpc.StatusCode.ALREADY_EXISTS,
            ["reflected"],
            "CreateObject",
            parent=self.scene,
            object_id="reflected",
            object=self.wall(0.3),
        )

    def step_a_stale_revision_is_refused_and_changes_nothing(self):
        now = self.revision()
        self.refused(
            grpc.StatusCode.ABORTED,
            ["scene_revision", str(now - 1), str(now)],
            "UpdateObject",
            object=self.wall(0.1, name=self.object),
            scene_revision=now - 1,
        )
        assert self.revision() == now
        assert self.scenes("GetObject", name=self.object).half_space.point_m.x == 0.31

    def step_a_negative_stiffness_is_refused_by_field_value_and_range(self):
        now = self.revision()
        self.refused(
            grpc.StatusCode.INVALID_ARGUMENT,
            ["stiffness", "-5", "N/m"],
            "UpdateObject",
            object=self.wall(0.31, stiffness=-5.0, name=self.object),
        )
        assert self.revision() == now

    def step_a_stiffness_that_is_no_number_is_refused(self):
        self.refused(
            grpc.StatusCode.INVALID_ARGUMENT,
            ["stiffness", "NaN"],
            "UpdateObject",
            object=self.wall(0.31, stiffness=math.nan, name=self.object),
        )

    def step_another_device_is_not_found(self):
        self.refused(
            grpc.StatusCode.NOT_FOUND, ["devices/"], "GetScene", name="devices/elsewhere/scene"
        )

    def step_the_wall_is_deleted_with_the_right_revision(self):
        now = self.revision()
        answer = self.scenes("DeleteObject", name=self.object, scene_revision=now)
        assert answer.scene_revision == now + 1 == self.revision()
        self.refused(grpc.StatusCode.NOT_FOUND, ["reflected"], "GetObject", name=self.object)

    def step_a_deleted_wall_is_not_felt(self):
        state = self.feel("the scene without it", lambda s: s.scene_revision == self.revision())
        assert self.touched(state) is None, state


def main():
    if not 2 <= len(sys.argv) <= 3:
        print(__doc__, file=sys.stderr)
        return 2
    walk = Walk(Server(*sys.argv[1:]))
    steps = [name for name in vars(Walk) if name.startswith("step_")]
    passed = failed = 0
    for name in steps:
        title = name.removeprefix("step_").replace("_", " ")
        try:
            getattr(walk, name)()
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

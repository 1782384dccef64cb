"""ROS by rosbridge: a server that speaks its protocol, and a client that subscribes."""

import json
from importlib.util import find_spec

import pytest

from gpszip.live.sources import lines, ros, websocket
from gpszip.live.sources.ros import RosSource
from live.bodies import TIME
from live.receiving import Taken, running, send, serving, until
from live.receiving import run as finish

pytestmark = pytest.mark.skipif(find_spec("websockets") is None, reason="needs gpszip[live]")

TOPICS = {
    "/r1/odom": "nav_msgs/msg/Odometry",
    "/r1/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/r1/goal_pose": "geometry_msgs/msg/PoseStamped",
    "/r2/odom": "nav_msgs/Odometry",
    "/rosout": "rcl_interfaces/msg/Log",
}


def pose(seconds, x, y=0.0, frame="map", **more):
    stamp = {"sec": TIME + int(seconds // 1), "nanosec": int(seconds % 1 * 1e9)}
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = 0.02
    return {
        "header": {"stamp": stamp, "frame_id": frame},
        "pose": {
            "pose": {
                "position": {"x": x, "y": y, "z": 0.0},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
            "covariance": covariance,
        },
        **more,
    }


def publish(topic, message):
    return {"op": "publish", "topic": topic, "msg": message}


class Bridge:
    """A rosbridge with rosapi that publishes messages once their topics are subscribed to."""

    def __init__(self, messages, topics=TOPICS):
        self.messages, self.topics, self.asked = messages, topics, []

    async def __call__(self, connection):
        async for text in connection:
            request = json.loads(text)
            self.asked.append(request)
            if request["op"] == "call_service":
                values = {"topics": list(self.topics), "types": list(self.topics.values())}
                answer = {"op": "service_response", "service": request["service"]}
                answer |= {"id": request["id"], "values": values, "result": True}
                await send(connection, answer)
                continue
            ready = self.messages.pop(request["topic"], [])
            await send(connection, *ready)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(websocket, "RETRY_SECONDS", (0.01, 0.02))
    monkeypatch.setattr(lines, "_RETRY_SECONDS", 0.01)


def listen(bridge, expected, *, topics=(), name="", full=0):
    """Run a source until it has stored so many fixes; return what it did."""
    taken = Taken(full)

    async def run():
        async with serving(bridge) as port:
            source = RosSource(f"ws://127.0.0.1:{port}", topics, name, taken.notices)
            async with running(source, taken):
                await until(lambda: len(taken.fixes) >= expected)

    finish(run())
    return taken


def test_one_topic_of_each_robot_is_chosen_and_a_jump_is_a_break():
    odometry = {"twist": {"twist": {"linear": {"x": 3.0, "y": 4.0, "z": 0.0}}}}
    places = [0.0, 0.1, 0.2, 20.0, 20.1]
    bridge = Bridge(
        {
            "/r1/pose": [publish("/r1/pose", pose(t / 10, x)) for t, x in enumerate(places)],
            "/r2/odom": [publish("/r2/odom", pose(0, 7.0, **odometry))],
        }
    )
    taken = listen(bridge, 6)
    subscribed = [request["topic"] for request in bridge.asked if request["op"] == "subscribe"]
    assert subscribed == ["/r1/pose", "/r2/odom"]
    first = [fix for fix in taken.fixes if fix.agent == "r1"]
    assert [fix.position for fix in first] == [(x, 0.0) for x in places]
    assert [fix.time for fix in first] == pytest.approx([TIME + t / 10 for t in range(5)])
    assert ["break" in fix.quality for fix in first] == [False, False, False, True, False]
    assert {(fix.source, fix.geographic, fix.accuracy, fix.heading) for fix in first} == {
        ("ros", False, 0.2, 90.0)
    }
    (second,) = (fix for fix in taken.fixes if fix.agent == "r2")
    assert (second.speed, second.kind) == (5.0, "Odometry")
    assert "r1: topics subscribed to (/r1/pose)" in taken.lines
    assert "r1: positions that jumped, taken as a break (19.8 m)" in taken.lines


def test_topics_that_are_named():
    fix = {
        "header": {"stamp": {"secs": TIME, "nsecs": 0}},
        "status": {"status": 0},
        "latitude": 48.1,
        "longitude": 11.5,
        "position_covariance": [8.0, 0, 0, 0, 8.0, 0, 0, 0, None],
        "position_covariance_type": 2,
    }
    lost = fix | {"status": {"status": -1}}
    bridge = Bridge({"/fix": [publish("/fix", lost), publish("/fix", fix)]})
    taken = listen(bridge, 1, topics=["fix"], name="rover")
    assert bridge.asked == [{"op": "subscribe", "id": "gpszip", "topic": "/fix"}]
    (found,) = taken.fixes
    assert (found.agent, found.time, found.position) == ("rover", TIME, (48.1, 11.5))
    assert (found.accuracy, found.kind) == (4.0, "NavSatFix")
    assert taken.reasons == ["messages of receivers without a fix left out"]


def test_another_frame_is_a_break():
    messages = [pose(t / 10, 0.0, frame="map" if t < 2 else "site") for t in range(4)]
    bridge = Bridge({"/r/p": [publish("/r/p", each) for each in messages]})
    taken = listen(bridge, 4, topics=["r/p"])
    assert ["break" in fix.quality for fix in taken.fixes] == [False, False, True, False]


def test_what_is_wrong_is_left_out_and_the_rest_is_stored(monkeypatch):
    good = json.dumps(publish("/r/p", pose(1, 0.5)))
    messages = [
        "{",
        "7",
        "[" * 99,
        b"\xff\xfe",
        json.dumps({"op": "png", "data": "x"}),
        json.dumps({"op": "status", "level": "error", "msg": "Cannot \x1b[2J infer"}),
        json.dumps(publish("/other", pose(0, 0.0))),
        json.dumps(publish(["/r/p"], 7)),
        json.dumps(publish("/r/p", 7)),
        json.dumps(publish("/r/p", {"pose": {"pose": [], "position": 7}, "header": []})),
        json.dumps(publish("/r/p", pose(0, None))),
        json.dumps(publish("/r/p", pose(0, True))),
        good.replace("0.5", "NaN"),
        # NaN elsewhere than in the position does no harm.
        good.replace("0.02", "NaN"),
    ]
    taken = listen(Bridge({"/r/p": messages}), 1, topics=["/r/p"])
    (fix,) = taken.fixes
    assert (fix.position, fix.accuracy) == ((0.5, 0.0), None)
    assert len(taken.items) == len(messages) - 2
    assert any("Cannot \\x1b[2J infer" in line for line in taken.lines)


def test_a_bridge_without_rosapi_is_told():
    class Silent(Bridge):
        async def __call__(self, connection):
            request = json.loads(await connection.recv())
            answer = {"op": "service_response", "id": request["id"], "values": "no such service"}
            await send(connection, answer | {"result": False})
            await until(lambda: any("start rosapi" in line for line in taken.lines))

    taken = Taken()

    async def run():
        async with serving(Silent({})) as port:
            source = RosSource(f"ws://127.0.0.1:{port}", (), "", taken.notices)
            async with running(source, taken):
                await until(lambda: any("went away" in line for line in taken.lines))

    finish(run())


def test_a_robot_that_goes_away_and_comes_back(monkeypatch):
    monkeypatch.setattr(ros, "_ASK_SECONDS", 0.01)
    taken = Taken(full=2)
    bridge = Bridge({}, topics={})

    async def run():
        async with serving(bridge) as port:
            source = RosSource(f"ws://127.0.0.1:{port}", (), "", taken.notices)
            async with running(source, taken):
                # The robot comes later than the bridge. The disk is full for a while.
                await until(lambda: len(bridge.asked) > 1)
                bridge.messages["/r/p"] = [publish("/r/p", pose(0, 0.0))]
                bridge.topics = {"/r/p": "geometry_msgs/msg/PoseStamped"}
                await until(lambda: len(taken.fixes) == 1)
                # The bridge goes away, and comes back at its port.
                bridge.messages["/r/p"] = [publish("/r/p", pose(1, 1.0))]
                return port, source

    async def again():
        port, source = await run()
        async with running(source, taken):
            await until(lambda: any("went away" in line for line in taken.lines))
            async with serving(bridge, port):
                await until(lambda: len(taken.fixes) == 2)

    finish(again())
    assert "rosbridge at 127.0.0.1: connected again" in taken.lines
    assert "no topic with positions yet" in " ".join(taken.lines)


def test_a_message_that_is_too_large_ends_the_connection_and_no_more(monkeypatch):
    large = "x" * (websocket.MAX_MESSAGE_BYTES + 1)
    bridge = Bridge({"/r/p": [large]})

    async def run():
        async with serving(bridge) as port:
            source = RosSource(f"ws://127.0.0.1:{port}", ["/r/p"], "", taken.notices)
            async with running(source, taken):
                await until(lambda: "rosbridge at 127.0.0.1: connected again" in taken.lines)

    taken = Taken()
    finish(run())
    assert any("went away" in line for line in taken.lines)

"""MAVLink: packets that pymavlink packs, over UDP, TCP and from a file."""

import asyncio
import math
import socket
from importlib.util import find_spec

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.cli.main import main
from gpszip.errors import OptionError
from gpszip.live import Fix, Notices, Unusable
from gpszip.live.formats.mavlink import MavlinkParser
from gpszip.live.sources import lines
from gpszip.live.sources.mavlink import Packets, open_mavlink
from live.bodies import LAT, LON, TIME
from live.receiving import Taken, running, until
from live.receiving import run as finish
from live.running import stored
from live.servers import free_port
from random_tests import examples

pytestmark = pytest.mark.skipif(find_spec("pymavlink") is None, reason="needs gpszip[mavlink]")


class Vehicle:
    """A system that packs messages; it began ``boot`` seconds before ``TIME``."""

    def __init__(self, system=1, component=1, version=2):
        from pymavlink.dialects.v20 import common

        self.common = common
        self._link = common.MAVLink(None, system, component)
        self._is_old = version == 1

    def pack(self, message):
        return message.pack(self._link, force_mavlink1=self._is_old)

    def clock(self, since, unix=None):
        unix = TIME + since if unix is None else unix
        return self.pack(self._link.system_time_encode(int(unix * 1e6), int(since * 1e3)))

    def position(self, since, lat=LAT, lon=LON, **more):
        values = {"vx": 300, "vy": 400, "vz": 0, "hdg": 27_000} | more
        return self.pack(
            self._link.global_position_int_encode(
                int(since * 1e3), round(lat * 1e7), round(lon * 1e7), 519_000, 0, **values
            )
        )

    def gps(self, since, lat=LAT, lon=LON, fix_type=3):
        values = [90, 90, 500, 65_535, 9, 519_000, 1_500, 0, 0, 0]
        at = round(lat * 1e7), round(lon * 1e7), 519_000
        usec = int(since * 1e6)
        return self.pack(self._link.gps_raw_int_encode(usec, fix_type, *at, *values))

    def odometry(self, since, x, y, resets=0, frame=1, quality=50):
        zeros = [0.0] * 21
        message = self._link.odometry_encode(
            int(since * 1e6),
            frame,
            8,
            x,
            y,
            0,
            [1, 0, 0, 0],
            3,
            4,
            0,
            0,
            0,
            0,
            zeros,
            zeros,
            resets,
        )
        message.quality = quality
        return self.pack(message)

    def local(self, since, x, y):
        return self.pack(self._link.local_position_ned_encode(int(since * 1e3), x, y, 0, 1, 0, 0))


def parse(*packets, local=False, name="drone", received=TIME + 99.0):
    """Fixes and others of packets, and what was told."""
    told = []
    found = Packets(MavlinkParser(name, Notices(told.append), local=local))
    items = [item for data in packets for item in found.push(data, received)]
    return (
        [item for item in items if isinstance(item, Fix)],
        [item.reason for item in items if isinstance(item, Unusable)],
        told,
    )


@pytest.mark.parametrize("version", [1, 2])
def test_positions_have_the_clock_of_their_system(version):
    one, two = Vehicle(1, version=version), Vehicle(2, version=version)
    fixes, reasons, _ = parse(
        one.position(1.0),
        one.clock(2.0),
        one.position(2.5),
        two.position(7.0, lat=48.0),
        two.clock(7.0, unix=0),
        two.position(8.0, lat=48.0),
    )
    assert reasons == []
    assert [fix.agent for fix in fixes] == ["drone-1", "drone-1", "drone-2", "drone-2"]
    # Before there is a clock, and without one, receipt counts.
    assert [fix.time for fix in fixes] == [TIME + 99, TIME + 2.5, TIME + 99, TIME + 99]
    assert [fix.quality for fix in fixes] == ["arrival", "", "arrival", "arrival"]
    assert fixes[1].position == pytest.approx((LAT, LON), abs=1e-7)
    assert (fixes[1].speed, fixes[1].heading, fixes[1].kind) == (5.0, 270.0, "GLOBAL_POSITION_INT")


def test_a_system_that_begins_anew_has_another_clock():
    vehicle = Vehicle()
    fixes, _, told = parse(
        vehicle.clock(100.0),
        vehicle.position(101.0),
        # Packets may be out of order.
        vehicle.position(100.9),
        vehicle.position(3.0),
        vehicle.clock(4.0, unix=TIME + 500),
        vehicle.position(5.0, hdg=65_535),
    )
    times = [TIME + 101, TIME + 100.9, TIME + 99, TIME + 501]
    assert [fix.time for fix in fixes] == pytest.approx(times)
    assert fixes[-1].heading is None
    assert told == ["drone-1: systems that began anew"]


def test_the_receiver_counts_only_where_the_autopilot_has_no_position():
    vehicle, camera = Vehicle(), Vehicle(component=100)
    fixes, reasons, _ = parse(
        vehicle.clock(1.0),
        vehicle.gps(1.0, fix_type=1),
        vehicle.position(1.1, lat=0.0, lon=0.0),
        vehicle.gps(1.2),
        camera.position(1.2, lat=1.0),
        vehicle.position(1.3),
        vehicle.gps(1.4),
        camera.position(1.5, lat=1.0),
    )
    # What lies at 0,0 is left out by the screen.
    kinds = ["GLOBAL_POSITION_INT", "GPS_RAW_INT", "GLOBAL_POSITION_INT"]
    usable = [fix for fix in fixes if fix.position != (0.0, 0.0)]
    assert [fix.position[0] for fix in usable] == pytest.approx([LAT, 1.0, LAT], abs=1e-7)
    assert [fix.kind for fix in usable] == [kinds[1], kinds[0], kinds[2]]
    assert (usable[0].accuracy, usable[0].speed, usable[0].heading) == (1.5, 5.0, None)
    assert reasons == ["messages of receivers without a fix left out"]


def test_odometry_tells_its_resets():
    vehicle = Vehicle()
    fixes, reasons, _ = parse(
        vehicle.clock(1.0),
        vehicle.odometry(1.0, 1.0, 2.0),
        vehicle.local(1.05, 1.0, 2.0),
        vehicle.odometry(1.1, 1.0, 2.1),
        vehicle.odometry(1.2, math.nan, 2.1, resets=1),
        vehicle.odometry(1.3, 1.0, 2.2, resets=1),
        vehicle.odometry(1.4, 1.0, 2.3, resets=1, frame=4),
        vehicle.odometry(1.5, 1.0, 2.3, resets=1, frame=12),
        vehicle.odometry(1.6, 1.0, 2.3, resets=1, quality=-1),
        vehicle.odometry(1.7, 1.0, 2.3, resets=0),
        vehicle.position(1.8),
        local=True,
    )
    assert [fix.position for fix in fixes] == [
        (2.0, 1.0),
        pytest.approx((2.1, 1.0)),
        pytest.approx((2.2, 1.0)),
        pytest.approx((1.0, 2.3)),
        pytest.approx((2.3, 1.0)),
    ]
    assert [fix.quality for fix in fixes] == ["", "", "break", "", "break"]
    assert {(fix.geographic, fix.kind, fix.speed) for fix in fixes} == {(False, "ODOMETRY", 5.0)}
    assert reasons == [
        "messages without a position left out",
        "odometry in frames that have no map left out",
        "odometry that has failed left out",
    ]
    # Where there is no odometry, the estimate of the autopilot counts.
    fixes, _, _ = parse(vehicle.local(1.0, 3.0, 4.0), local=True)
    assert [fix.position for fix in fixes] == [(4.0, 3.0)]


@examples(100)
@given(st.lists(st.binary(max_size=60) | st.integers(0, 40), max_size=6))
def test_no_bytes_raise_and_packets_behind_them_are_found(parts):
    vehicle = Vehicle()
    good = vehicle.clock(1.0) + vehicle.position(1.0) + vehicle.gps(2.0)
    data = b"".join(part if isinstance(part, bytes) else good[part:-1] for part in parts)
    # 300 bytes end the longest packet that those before may have begun.
    fixes, _, _ = parse(data, b"\0" * 300, *(vehicle.clock(2.0), vehicle.position(2.5)))
    assert fixes[-1].position == pytest.approx((LAT, LON), abs=1e-7)


def test_datagrams_of_two_vehicles(monkeypatch):
    monkeypatch.setattr(lines, "_RETRY_SECONDS", 0.01)
    taken, port = Taken(full=1), free_port()
    source = open_mavlink(f"udp://127.0.0.1:{port}", "", taken.notices)

    async def run():
        async with running(source, taken):
            senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
            vehicles = Vehicle(1), Vehicle(2)
            # Nobody listens at first, so that some are lost.
            while {fix.agent for fix in taken.fixes} != {"mavlink-1", "mavlink-2"}:
                for sender, vehicle in zip(senders, vehicles, strict=True):
                    # A packet in two parts, as no link divides it, still is one.
                    data = vehicle.clock(1.0) + vehicle.position(1.0)
                    sender.sendto(data[:30], ("127.0.0.1", port))
                    sender.sendto(data[30:], ("127.0.0.1", port))
                await asyncio.sleep(0.01)
            for sender in senders:
                sender.close()

    finish(run())
    assert {fix.time for fix in taken.fixes} == {TIME + 1.0}


def test_a_server_over_udp_is_told_that_somebody_listens():
    taken = Taken()

    async def run():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
            server.bind(("127.0.0.1", 0))
            server.setblocking(False)
            address = f"udpout://127.0.0.1:{server.getsockname()[1]}"
            async with running(open_mavlink(address, "", taken.notices), taken):
                loop = asyncio.get_running_loop()
                data, client = await loop.sock_recvfrom(server, 500)
                await loop.sock_sendto(server, Vehicle().position(1.0), client)
                await until(lambda: taken.fixes)
                return data

    data = finish(run())
    (message,) = Packets(MavlinkParser("", taken.notices, local=False))._decoder.parse_buffer(data)
    # A ground station's would keep a vehicle from noticing that the real one is gone.
    assert (message.get_type(), message.type, message.get_srcSystem()) == ("HEARTBEAT", 18, 245)


def test_a_server_over_tcp_that_goes_away(monkeypatch):
    from gpszip.live.sources import connection

    monkeypatch.setattr(connection, "RETRY_SECONDS", (0.01, 0.02))
    taken = Taken()

    async def run():
        vehicle, number = Vehicle(), iter(range(9))

        async def answer(_reader, writer):
            writer.write(vehicle.clock(0.0) + vehicle.position(next(number)))
            writer.close()

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        source = open_mavlink(f"tcp://127.0.0.1:{port}", "", taken.notices)
        async with server, running(source, taken):
            await until(lambda: len(taken.fixes) >= 2)

    finish(run())
    assert [fix.time for fix in taken.fixes][:2] == [TIME, TIME + 1]
    assert "127.0.0.1: connected again" in taken.lines


def test_a_file_to_its_end(tmp_path, capfd):
    vehicle = Vehicle()
    path = tmp_path / "link.bin"
    packets = [vehicle.odometry(t / 10, 0.0, t / 10 + 50 * (t > 5)) for t in range(1, 10)]
    path.write_bytes(b"?" + vehicle.clock(0.0) + b"".join(packets))
    journal = tmp_path / "journal"
    words = ["--mavlink", f"{path}?frame=local", "--name", "rover"]
    assert main(["listen", "--journal", str(journal), *words]) == 0
    told = capfd.readouterr().err
    assert "rover-1: positions that jumped, taken as a break (50.1 m)" in told
    assert "9 fixes stored" in told
    fixes = stored(journal)
    assert [fix.position[0] for fix in fixes] == pytest.approx(
        [t / 10 + 50 * (t > 5) for t in range(1, 10)]
    )
    assert [n for n, fix in enumerate(fixes) if "break" in fix.quality] == [5]


@pytest.mark.parametrize("address", ["ftp://a", "tcp://", "udp://:99999", "tcp://a:1?frame=body"])
def test_wrong_addresses(address):
    with pytest.raises(OptionError):
        open_mavlink(address, "", Notices(str))

"""Writers of small exports as people get them from Strava, Garmin, Google, Apple and OwnTracks.

Each returns the files of the export by their names. Every activity has :data:`N` points.
"""

import gzip
import io
import zipfile
from datetime import UTC, datetime, timedelta

from oracle import fit, google

START = datetime(2021, 5, 4, 7, tzinfo=UTC)

#: Points of each activity.
N = 60

PICTURE = b"\x89PNG\r\n\x1a\n\0\0"


def rows(day, device=0):
    """Time, latitude, longitude and device of a way to work and back, with a point every 10 s."""
    return [
        (
            START + timedelta(days=day, seconds=10 * i),
            52.51 + min(i, N - 1 - i) / 2000,
            13.4 + (day + i % 2) / 1e5,
            device,
        )
        for i in range(N)
    ]


def gpx(day, name):
    points = "".join(
        f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><ele>34</ele>'
        f"<time>{google.iso(time)}</time></trkpt>"
        for time, lat, lon, _ in rows(day)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?><gpx version="1.1" creator="a watch" '
        f'xmlns="http://www.topografix.com/GPX/1/1"><trk><name>{name}</name>'
        f"<trkseg>{points}</trkseg></trk></gpx>"
    ).encode()


def tcx(day, *, indoors=False):
    points = "".join(
        f"<Trackpoint><Time>{google.iso(time)}</Time>"
        + (
            ""
            if indoors
            else f"<Position><LatitudeDegrees>{lat:.7f}</LatitudeDegrees>"
            f"<LongitudeDegrees>{lon:.7f}</LongitudeDegrees></Position>"
        )
        + "<HeartRateBpm><Value>120</Value></HeartRateBpm></Trackpoint>"
        for time, lat, lon, _ in rows(day)
    )
    # Strava writes blanks before the declaration.
    return (
        '          <?xml version="1.0"?><TrainingCenterDatabase><Activities>'
        '<Activity Sport="Biking">'
        f"<Id>{google.iso(rows(day)[0][0])}</Id><Lap><Track>{points}</Track></Lap>"
        "</Activity></Activities></TrainingCenterDatabase>"
    ).encode()


def activity(day):
    records = [fit.record(round(time.timestamp()), lat, lon) for time, lat, lon, _ in rows(day)]
    return fit.fit(fit.file_id(), *records)


def monitoring(day):
    """A file of steps without a position, as watches write several each day."""
    time = round(rows(day)[0][0].timestamp()) - fit.EPOCH
    steps = [(fit.MONITORING, [(253, fit.UINT32, time + 60 * i)]) for i in range(5)]
    return fit.fit(fit.file_id(fit.MONITORING_B), *steps)


def strava():
    return {
        "activities.csv": (
            b"Activity ID,Activity Date,Activity Name,Activity Type,Activity Description,"
            b"Elapsed Time,Distance,Filename\n"
            b'1,"May 4, 2021, 7:00:00 AM",Morning Ride,Ride,"to work,\nand back",590,6.1,'
            b"activities/1.gpx\n"
            b'2,"May 5, 2021, 7:00:00 AM",Morning Ride,Ride,,590,6.1,activities/2.gpx.gz\n'
        ),
        "activities/1.gpx": gpx(0, "Morning Ride"),
        "activities/2.gpx.gz": gzip.compress(gpx(1, "Morning Ride")),
        "activities/3.tcx.gz": gzip.compress(tcx(2)),
        "activities/4.fit.gz": gzip.compress(activity(3)),
        "activities/5.tcx.gz": gzip.compress(tcx(4, indoors=True)),
        "media/a.jpg": PICTURE,
        "media/b.jpg": PICTURE + b"\0",
        "profile.csv": b"Athlete ID,Email Address,First Name\n7,a@b.org,A\n",
        "clubs.csv": b"",
        "contacts.csv": b"First Name,Last Name\n",
        "bikes.csv": b"Bike Name,Bike Brand\nred,none\n",
        "messaging.json": b'[{"text": "hello"}]',
    }


def garmin():
    uploaded = {f"a_{day}.fit": activity(day) for day in range(3)}
    uploaded |= {f"a_{100 + day}.fit": monitoring(day) for day in range(5)}
    folder = "DI_CONNECT"
    return {
        f"{folder}/DI-Connect-Uploaded-Files/UploadedFiles_0-_Part1.zip": zipped(uploaded),
        f"{folder}/DI-Connect-Uploaded-Files/UploadedFiles_0-_Part2.zip": zipped(
            {"a_3.fit": activity(3), "again_0.fit": activity(0), "course.txt": b"A course\n"}
        ),
        f"{folder}/DI-Connect-Fitness/a_0_summarizedActivities.json": (
            b'[{"summarizedActivitiesExport": [{"activityId": 1, "startLatitude": 52.5}]}]'
        ),
        f"{folder}/DI-Connect-User/user_profile.json": b'{"userName": "a"}',
        "customer_data/customer.json": b'{"emailAddress": "a@b.org"}',
    }


def takeout():
    """Positions stand in Records.json, as paths in months, and the last ones among edits."""
    history = "Takeout/Location History (Timeline)"
    # Files come in any order in an archive.
    return {
        f"{history}/Semantic Location History/2021/2021_MAY.json": google.encode(
            google.months(rows(0))
        ),
        f"{history}/Timeline Edits.json": google.encode(google.edits(rows(1))),
        f"{history}/Settings.json": b'{"createdTime": "2015-01-01T00:00:00Z"}',
        f"{history}/Tombstones.csv": b"Deletion time,Start time,End time\n",
        f"{history}/Records.json": google.encode(google.records(rows(0, 5) + rows(1, 5))),
        "Takeout/archive_browser.html": b"<!DOCTYPE html><html><body>Takeout</body></html>",
    }


def apple():
    folder = "apple_health_export"
    return {
        f"{folder}/export.xml": (
            b'<?xml version="1.0" encoding="UTF-8"?>\n<!DOCTYPE HealthData [\n'
            b"<!ELEMENT HealthData (Record*)>\n]>\n<HealthData locale='en'>"
            b"<Record type='HKQuantityTypeIdentifierStepCount' value='7'/></HealthData>"
        ),
        f"{folder}/export_cda.xml": b'<?xml version="1.0"?><ClinicalDocument/>',
        f"{folder}/electrocardiograms/ecg_2021-05-04.csv": (
            b'Name,A\nDate of Birth,"Jan 1, 1990"\nClassification,Sinus Rhythm\n'
            b"Sample Rate,512 hertz\n\n\nLead,Lead I\nUnit,\xc2\xb5V\n\n12.5\n13.5\n-4\n"
        ),
        f"{folder}/workout-routes/route_2021-05-04_9.41am.gpx": gpx(0, "Route 2021-05-04 9:41am"),
        f"{folder}/workout-routes/route_2021-05-05_9.41am.gpx": gpx(1, "Route 2021-05-05 9:41am"),
    }


def days():
    """Files of one day each, as OsmAnd, GPSLogger and OwnTracks write them."""
    return {f"2021-05/{4 + day:02}.gpx": gpx(day, f"2021-05-{4 + day:02}") for day in range(3)}


def zipped(files):
    with zipfile.ZipFile(file := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return file.getvalue()


def unpacked(files, folder):
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)

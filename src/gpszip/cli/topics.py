"""Texts of ``gpszip help TOPIC``: what several commands share."""

from __future__ import annotations

__all__ = ["TOPICS"]

#: Text of each topic by its name. Lines end at 80 columns.
TOPICS = {
    "errors": """\
Bounds on the error

--rmse LENGTH bounds the root mean square error, --max-error LENGTH the error of
every point; both may be given. --bytes and --ratio bound the size instead, and
the smallest error that fits is searched. Without any of these, an RMSE that
suits the noise of the log is estimated, with a maximum of four times that.

The error of a point is its distance from the archive's position at the point's
own time, in metres. It is measured at every point, on the bytes that were
written. If a bound can't be held, nothing is written, and the exit code is 6.
""",
    "units": """\
Units

lengths     24cm  5m  2km  100ft  1mi       a bare number is in metres
durations   250ms  30s  10min  2h  1d       a bare number is in seconds
sizes       900  4KiB  64kB  1GiB           a bare number is in bytes

Times in commands are dates such as 2024-05-01T10:00:00Z, in UTC where they have
no zone, or seconds as the log counts them.
""",
    "exit-codes": """\
Exit codes

  0  done
  1  failed, such as a file that can't be read or written
  2  wrong usage
  3  done, but inputs or many points were left out; the first lines name them
  4  a corrupt archive
  5  the map of an archive is missing, or is another one
  6  the bound on the error or the size can't be held
130  interrupted
""",
    "environment": """\
Environment variables

An option on the command line wins over its variable.

GPSZIP_EFFORT      --effort of compress
GPSZIP_MEMORY      --memory of compress, such as 1GiB
GPSZIP_WORKERS     --workers
GPSZIP_ENGINE      --engine: threads or processes
GPSZIP_SCHEDULER   --scheduler: the address of a Dask cluster
GPSZIP_TOKEN       --token of listen and replay
GPSZIP_EVENTS_KEY  --sign of listen
GPSZIP_OWNTRACKS_KEY
                   key of encrypted messages of OwnTracks, for listen
NO_COLOR           no colours in progress bars
TMPDIR             where logs larger than memory are sorted

Credentials and regions of object storage, such as AWS_ENDPOINT_URL, are those
of the storage's own tools.
""",
    "input": """\
Logs

A LOG is a file, a pattern such as 'walks/*.gpx', a folder or zip archive of
files, such as an export of Strava or Google, a URL such as
s3://bucket/logs/*.parquet, or - for standard input. Its content decides on its
format, not its name. It may be packed with gzip.

Files of a folder or archive that hold no positions are left out and counted; a
log that can't be read is named, and the exit code is 3.

Tables need a column of times, and x,y[,z] in metres or lat,lon in degrees;
columns are found by name, or named with --columns t=when,x=east,y=north.

gpszip formats lists all formats.
""",
    "output": """\
Outputs

-o FILE names the output; - is standard output. Without -o, commands that read
one file derive a name, beside the input:

compress     walk.gpx    ->  walk.gpsz
decompress   walk.gpsz   ->  walk.csv
map          walk.gpsz   ->  walk-map.geojson
match        drive.csv   ->  drive-routes.geojson
view         walk.gpsz   ->  walk.html, in the current folder

No file is replaced without --force. A file is complete or not there at all.
Standard output carries data only: summaries, progress and errors go to standard
error.
""",
}

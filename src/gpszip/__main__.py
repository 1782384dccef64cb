"""``python -m gpszip``: the gpszip command where its script is not on the PATH."""

from gpszip.cli.main import run

if __name__ == "__main__":
    run()

"""GPSZip learns the map that position logs repeat, and stores the logs as walks on it."""

__version__ = "0.1.0"

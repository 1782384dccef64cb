"""Logs of GPS receivers in NMEA 0183."""

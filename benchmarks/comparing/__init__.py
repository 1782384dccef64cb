"""Comparison of GPSZip with its peers: logs, measurements, tables and figures."""

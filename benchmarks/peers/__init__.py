"""What a user would take instead of GPSZip: codecs of tracks within a maximum error.

Each is run as a process of its own by ``benchmarks/frontier.py``: see ``peers/__main__.py``.
"""

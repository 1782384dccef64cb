"""XML that may be large, damaged or hostile, and the points of logs in it."""

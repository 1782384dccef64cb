"""Pages for browsers, and pictures with matplotlib, of archives, maps and logs."""

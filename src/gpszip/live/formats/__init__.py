"""Messages of phones, trackers and receivers, turned into fixes: one module for each kind."""

"""Numbers, coordinates and timestamps from columns of text or numbers."""

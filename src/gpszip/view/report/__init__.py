"""Reports on the history of an archive: numbers, sentences, tables and pictures in one page."""

"""Sources of fixes, one module for each."""

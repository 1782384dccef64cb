"""Pictures for papers, one module for each kind."""

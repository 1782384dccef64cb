"""Reading and making frames: tables and trajectories of other Python packages."""

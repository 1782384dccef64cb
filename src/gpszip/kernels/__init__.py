"""Settings of the compiler, and the compiled helpers that several packages share."""

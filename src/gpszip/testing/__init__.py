"""Generators and strategies for tests, ours and yours."""

"""What has changed on a map: closed, new, moved, slower and one-way edges."""

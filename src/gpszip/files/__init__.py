"""Files that are there whole or not at all, whatever fails; temporary folders; errors of disks in plain words."""

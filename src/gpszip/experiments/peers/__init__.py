"""What users would pick instead of GPSZip: simplifiers and coders, and files made with both."""

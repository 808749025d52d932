"""What makes programs start quickly, and what other packages add to them."""

"""Programs that people write on the page, and what their browsers need to run them."""

"""What every room may use of the machine it runs on: virtual time, and the folders of the user."""

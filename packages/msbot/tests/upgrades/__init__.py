"""What earlier versions have stored is opened by this one."""

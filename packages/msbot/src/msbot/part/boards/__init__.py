"""GPIO boards: real ones and a simulated one."""

"""Teaching with MsBOT: lessons, missions, the fault lab, a class of robots, the sample robots."""

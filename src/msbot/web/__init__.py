"""The web pages of a robot and their JSON API (the thesis' Manual Configuration Management System, 5.4.2).

Heavy to import (NiceGUI), so only commands that serve a page import it, and only when they run.
"""

from msbot.runtime.late_modules import leave_out, load_late

load_late("aiohttp", "requests")  # for socket.io's client, which comes with its server and is used by nobody here
load_late("ifaddr")  # for NiceGUI's list of its addresses, which asks a program of the system for a library
leave_out("pydantic.v1")  # FastAPI asks of each argument whether it is of pydantic 1, which is loaded for it

"""The web pages of a robot and their JSON API (the thesis' Manual Configuration Management System, 5.4.2).

Heavy to import (NiceGUI), so only commands that serve a page import it, and only when they run.
"""

"""The web pages of a robot and their JSON API (the thesis' Manual Configuration Management System, 5.4.2).

Heavy to import (NiceGUI): only the commands that serve a page do so, when they do.
"""

"""Asks a robot's page how its slots are, and holds the robot for a moment."""

import json
import os
from urllib.request import Request, urlopen

PAGE = os.environ.get("MSBOT_PAGE", "http://127.0.0.1:8080")
HEADERS = {"Authorization": f"Bearer {os.environ['MSBOT_TOKEN']}", "Content-Type": "application/json"}


def ask(method, path, **body):
    data = json.dumps(body).encode() if body else None
    with urlopen(Request(PAGE + path, data, HEADERS, method=method)) as answer:
        return json.load(answer)


for slot in ask("GET", "/api/robot")["slots"]:
    print(f"{slot['name']}: {slot['state']}, {slot['reason']}")
print(ask("POST", "/api/stop", reason="the program says so")["words"])
print(ask("POST", "/api/go")["words"])

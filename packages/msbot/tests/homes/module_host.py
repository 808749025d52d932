"""Runs inside the VM (see vm.mjs): imports a module of the package, and says what is in use.

{"do": "import", "name": NAME}
{"do": "forget", "name": NAME}
{"do": "collect"}, then {"do": "memory"}
"""

import gc
import json

import msbot


def answer(line):
    request = json.loads(line)
    if request["do"] == "import":
        from msbot.running import load

        load(request["name"])
    elif request["do"] == "forget":
        from msbot.running import forget

        forget(request["name"])
    elif request["do"] == "collect":
        gc.collect()  # this VM collects when the call is over
    return json.dumps({"octets": gc.mem_alloc(), "msbot": msbot.__version__})

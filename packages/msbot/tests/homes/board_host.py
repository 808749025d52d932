"""Runs after `vm_host.py` in the same place: a generic board in place of a program, and the world behind its pins.

{"do": "board", "link": "can"|"serial", "uid": HEX, "key": HEX|null, "now": MS, "files": {NAME: TEXT}}
{"do": "machine", "call": NAME, "with": [...]}     one of the functions of `fake_machine.py`; answers {"is": ...}
{"do": "files"}                                    what the board keeps
"""


class _Board:
    """A generic board, as `vm_host` sees a part."""

    def __init__(self, board):
        self.board = board
        self.step = board.step
        self.part = board.part

    def __getattr__(self, name):
        return getattr(self.part, name)


def _start_board(request):
    global _wire

    from msbot.generic import GenericBoard

    import msbot

    msbot.listen(_say)
    for name, text in request["files"].items():
        with open(name, "w") as file:
            file.write(text)
    _wire = Wire(request["link"] == "serial")
    part = msbot.Part("BOARD-8", local_name="front", uid=bytes.fromhex(request["uid"]), key=request["key"])
    board = GenericBoard(part)
    _parts.append(_Board(board))
    board.begin(_make_link(request["link"], _wire), request["now"])


_answer_of_a_program = answer


def answer(line):
    request = json.loads(line)
    if request["do"] == "board":
        _start_board(request)
        return _answer_of_a_program('{"do": "look", "now": 0}').replace('"due": null', '"due": %d' % request["now"])
    if request["do"] == "end":
        _parts[0].board.end()
        return _answer_of_a_program('{"do": "look", "now": 0}').replace('"due": null', '"due": %d' % request["now"])
    if request["do"] == "machine":
        import machine

        return json.dumps({"is": getattr(machine, request["call"])(*request["with"])})
    if request["do"] == "files":
        found = {}
        for name in ("parts.json", "parts.json.new"):
            try:
                with open(name) as file:
                    found[name] = file.read()
            except OSError:
                pass
        return json.dumps({"is": found})
    return _answer_of_a_program(line)

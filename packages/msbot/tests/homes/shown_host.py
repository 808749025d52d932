"""Runs inside the VM (see vm.mjs): `shown` of a page, for a message of {"number": NUMBER}, sent and as it comes in."""

import json

from msbot.message import field, float32, float64
from shown import shown

import msbot


class Inner(msbot.Message):
    level = field(float32)


class Sample(msbot.Message):
    small = field(float32)
    large = field(float64)
    words = field(str)
    inner = field(Inner)


def answer(line):
    number = float(json.loads(line)["number"])
    sample = Sample(small=number, large=number, words="it's", inner=Inner(level=number))
    return json.dumps({"sent": shown(sample), "came": shown(sample.encode(), Sample), "bad": shown(b"1", Sample)})

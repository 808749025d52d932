"""Serves its partner's requests, and makes mistakes."""

from msbot import CallError, Number, Part, Text

part = Part("TEST-1")


@part.serves("double", Number, Text)
def double(request):
    print("asked", request.value)
    if request.value < 0:
        raise CallError("not below zero")
    if request.value == 0:
        return request
    if request.value == 1000:
        return Text(text=3)
    if request.value > 1e6:
        raise ValueError("too large")
    return Text(text=str(2 * request.value))


@part.serves("shut", Number, Number)
def shut(request):
    return request


part.serves("none", Number, Text, optional=True)(double)
part.serves("way", Number, Text)(double)
for mistake in (
    lambda: part.serves(double),
    lambda: part.serves("other", Number),
    lambda: part.serves("double", Number, Text)(double),
):
    try:
        mistake()
    except Exception as error:
        print(error)
part.run()

"""A part that the robot does not know says what it serves and calls; its reply is not the library's."""

from msbot import Angle, Message, Number, Part, float32, uint8


class Picture(Message):
    width: uint8
    brightness: float32


part = Part("CAM-1", local_name="eye", describes="Camera")
part.calls("look", Angle, Number)


@part.serves("photo", Angle, Picture)
def photo(request):
    return Picture(width=1)


part.run()

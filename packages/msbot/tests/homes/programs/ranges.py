"""Values outside of the ranges that the library declares: sent, counted, and said once for each field."""

from msbot import Number, Part, Scan

part = Part("TEST-1")


@part.on_join
def joined():
    print("joined", sorted(part.settings.items()), part.out_of_range)
    for value in (0, 10, 10.5, -3, float("nan")):
        print("sent", part.publish("out", Number(value=value)), part.out_of_range)
    part.publish("scan", Scan(angle_min=0, angle_step=1, reach=5, metres=[1, 4, 4.5, 9]))
    print(part.out_of_range)


part.run()

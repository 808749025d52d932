"""Who talks on the bus of the demo: start `msbot demo --robot thesis --bus demo1` first."""

from collections import Counter

import can

heard = Counter()
with can.Bus(interface="msbot", channel="demo1", listen_only=True) as bus:
    for message in bus:
        heard[message.arbitration_id] += 1
        if heard.total() == 100:
            break
for can_id, count in heard.most_common():
    print(f"{can_id:03X}: {count}")

"""The flight recorder.

Theory of operation. In the robot's process, a sample costs one `append` to a list. Five times a second a thread packs
what has come and hands it to another process, which writes it to files: a slow disk, a full one or a crash of the robot
touches neither the robot nor what was recorded. That process writes short files one after the other and deletes the
oldest (`ring`); each begins with what was last known, so that each can be read alone.

`recorder` and `recorder_process` are the robot's side; `__main__`, `storing` and `recording_file` are the other
side, which imports nothing else of MsBOT, unless it writes a bag of ROS 2 (`bag`). `batch` is what passes between them.
"""

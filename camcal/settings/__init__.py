"""The settings of camcal, each defined once.

An `Option` (option.py) has a name, a kind (kinds.py, sizes.py: how a value is read and checked), a default and a
help text. The options of a stage are the fields of a dataclass (calibration.py, detection.py, tracking.py);
commands.py lists the options of every command. The command line, camcal.yaml, the environment, the keywords of
the Python interface, checkpoints and the `options` of a report are all made from these definitions.

Adding an option: one field or one `Option`, and its place in commands.py; a command gets its options from there by
the decorator `@options("name")` of `camcal.cli.options`. Nothing here imports numpy or cv2.
"""

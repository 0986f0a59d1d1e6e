"""The same arm, coupled by other means: each module is a program, `python -m … STEPS`."""

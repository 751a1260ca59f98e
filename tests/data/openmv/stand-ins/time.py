# Stand-in for OpenMV's time: MicroPython's own, and the clock of pictures.
from utime import *


class clock:
    def tick(s):
        pass

    def fps(s):
        return 30.0

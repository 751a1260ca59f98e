# Stand-in for OpenMV's pyb: what the UART sends goes to the standard error output, at its rate.
import sys
import time


class LED:
    def __init__(s, n):
        pass

    def on(s):
        pass

    def off(s):
        pass


class Servo:
    def __init__(s, n):
        pass

    def pulse_width(s, *a):
        pass


class UART:
    def __init__(s, n, baud, timeout_char=0):
        s.baud = baud

    def write(s, data):
        sys.stderr.buffer.write(data)
        time.sleep_ms(len(data) * 10000 // s.baud)

    def any(s):
        return 0

    def readchar(s):
        return -1

# Stand-in for OpenMV's csi. What the camera sees is in the file SCENE: a line with number, middle, size and pixels of
# each thing. A number of a tag, or the place of a threshold in the list of those that are switched on. The script may
# take properties of blobs and tags as attributes or, before 2026, as methods: then METHODS is set.
import os
import time

RGB565 = 1
GRAYSCALE = 2
QVGA = 3
QQVGA = 4


class Seen:
    def __init__(s, number, x, y, w, h, pixels):
        all = {
            "id": number,
            "code": 1 << number,
            "cx": x,
            "cy": y,
            "x": x - w // 2,
            "y": y - h // 2,
            "w": w,
            "h": h,
            "pixels": pixels,
            "area": w * h,
            "rect": (x - w // 2, y - h // 2, w, h),
            "rotation": 0.5,
        }
        for name in all:
            value = all[name]
            setattr(s, name, (lambda value=value: value) if os.getenv("METHODS") else value)


class Picture:
    def __init__(s, seen):
        s.seen = seen

    def find_blobs(s, thresholds, area_threshold=10, pixels_threshold=10, **_):
        def is_found(numbers):
            number, _, _, w, h, pixels = numbers
            return number < len(thresholds) and w * h >= area_threshold and pixels >= pixels_threshold

        return [Seen(*numbers) for numbers in s.seen if is_found(numbers)]

    def find_apriltags(s, *_, **__):
        return [Seen(*numbers) for numbers in s.seen]

    def __getattr__(s, name):
        return lambda *_, **__: 1


class CSI:
    def __getattr__(s, name):
        return lambda *_, **__: None

    def snapshot(s, time_=0, **_):
        time.sleep_ms(33)
        with open(os.getenv("SCENE")) as file:
            lines = file.read().split("\n")
        return Picture([[int(word) for word in line.split()] for line in lines if line])

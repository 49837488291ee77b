"""A vehicle with a camera that flies missions item by item: written apart from what cuts them, to compare before and after.

It moves straight from place to place in small steps over a flat plane, holds what it was ordered, and takes a picture when it is as far
from the last one as it was told. It shares with the code under test nothing but the classes that files are read into.
"""

import math
from dataclasses import dataclass, field
from functools import cache

import pyproj

STEP_M = 1.0
HELD = {
    178: "speed", 183: "servo", 181: "relay", 187: "actuator", 195: "roi", 197: "roi", 201: "roi", 80: "roi", 196: "roi",
    205: "gimbal", 1000: "gimbal", 530: "camera mode", 531: "zoom", 216: "sprayer", 218: "function", 2500: "video", 2501: "video",
    207: "fence",
}  # fmt: skip
"""MAV_CMD of orders that hold, and what they are about."""
NUMBERED = (183, 181, 218)


@cache
def projection(origin):
    """A plane on which distances from the origin are true."""
    return pyproj.Proj(proj="aeqd", ellps="WGS84", lat_0=origin[0], lon_0=origin[1])


@dataclass
class Vehicle:
    """Where it is, what it holds, and what it has done."""

    origin: tuple
    ground_m: float = 0.0
    at: tuple = (0.0, 0.0, 0.0)
    held: dict = field(default_factory=dict)
    every_m: float = 0.0
    every_s: float = 0.0
    elapsed_s: float = 0.0
    stopped: tuple = (0.0, 0.0)
    last_picture: tuple | None = None
    pictures: list = field(default_factory=list)
    track: list = field(default_factory=list)
    events: list = field(default_factory=list)
    speed: float = 5.0

    def plane(self, item):
        return self.place(item.x / 1e7, item.y / 1e7)

    def place(self, lat, lon):
        """Metres east and north of the origin."""
        east, north = projection(self.origin)(lon, lat)
        return float(east), float(north)

    def height(self, item):
        return item.z + self.ground_m if item.frame in (3, 6) else item.z

    def picture(self):
        self.pictures.append(self.at)
        self.last_picture = self.at[:2]
        self.elapsed_s = 0.0

    def state(self):
        return tuple(sorted((*self.held.items(), ("taking", self.every_m), ("speed", self.speed)), key=str))

    def go(self, place):
        length, held = math.dist(self.at[:2], place[:2]), self.state()
        begin, count = self.at, max(1, math.ceil(max(length, abs(place[2] - self.at[2])) / STEP_M))
        for number in range(1, count + 1):
            before, after = (self.between(begin, place, one / count) for one in (number - 1, number))
            seconds = length / count / self.speed
            if self.every_m and math.dist(self.last_picture, after[:2]) >= self.every_m:
                self.at = self.between(before, after, self.share_of_distance(before, after))
                self.picture()
            if self.every_s and self.elapsed_s + seconds >= self.every_s - 1e-9:
                part = min(max((self.every_s - self.elapsed_s) / seconds, 0.0), 1.0) if seconds else 0.0
                self.at = self.between(before, after, part)
                self.picture()
                self.elapsed_s = -part * seconds
            self.elapsed_s += seconds
            self.at = after
            self.track.append((self.at, held))

    def stay(self, seconds):
        """Stand where it is, with a camera that takes pictures by the clock."""
        self.elapsed_s += seconds
        while self.every_s and self.elapsed_s >= self.every_s - 1e-9:
            left = self.elapsed_s - self.every_s
            self.picture()
            self.elapsed_s = left

    @staticmethod
    def between(begin, end, share):
        return tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True))

    def share_of_distance(self, begin, end):
        """Where on a small step it is as far from the last picture as told, by halving."""
        low, high = 0.0, 1.0
        for _ in range(30):
            middle = 0.5 * (low + high)
            far = math.dist(self.last_picture, self.between(begin, end, middle)[:2]) >= self.every_m
            low, high = (low, middle) if far else (middle, high)
        return high

    def order(self, item):
        command, params = item.command, item.params
        if command in (206, 214, 2000, 2001):
            self.stopped = (0.0, 0.0)
        if command == 206:
            self.every_m, self.every_s = max(params[0], 0.0), 0.0
            if self.last_picture is None:
                self.last_picture = self.at[:2]
            if params[0] > 0 and params[2] == 1:
                self.picture()
        elif command == 214 or (command == 2000 and params[2] == 0 and params[1] > 0):
            self.every_s, self.every_m = (params[0] / 1000.0 if command == 214 else params[1]), 0.0
            if self.every_s > 0:
                self.picture()
        elif command == 2001:
            self.every_m = self.every_s = 0.0
        elif command == 2003 and params[0] == 0 and (self.every_m or self.every_s):
            self.stopped, self.every_m, self.every_s = (self.every_m, self.every_s), 0.0, 0.0
        elif command == 2003 and params[0] == 1 and not (self.every_m or self.every_s):
            self.every_m, self.every_s = self.stopped
            if self.every_s:
                self.picture()
        elif command == 178:
            if params[0] in (0, 1) and params[1] > 0:
                self.speed = params[1]
        elif command in HELD:
            key = (HELD[command], params[0]) if command in NUMBERED else HELD[command]
            nothing = command in (197, 2501) or (command == 216 and params[0] == 0)
            self.held.pop(key, None)
            if not nothing:
                z = round(self.height(item), 2) if command in (195, 201, 80) else 0.0
                self.held[key] = (*(0.0 if math.isnan(p) else p for p in params), item.x, item.y, z)
        elif command == 203 or (command == 2000 and params[2] >= 1):
            self.picture()
        elif command in (211, 42600, 182, 184):
            self.events.append((command, params, tuple(round(one) for one in self.at)))


def unrolled(mission, laps):
    """Numbers of items in the order that they are taken; jumps that never end are taken `laps` times."""
    done, order, number = {}, [], 0
    while number < len(mission.items):
        item = mission.items[number]
        if item.command == 177:
            times = laps if item.param2 < 0 else item.param2
            if done.get(number, 0) < times:
                done[number] = done.get(number, 0) + 1
                number = int(item.param1)
                continue
            if item.param2 >= 0:
                done[number] = 0
        else:
            order.append(number)
        number += 1
    return order


def fly(mission, vehicle, *, laps=1, speed=None, ardupilot=False):
    """Fly a mission with a vehicle from its home."""
    point = mission.home.point
    home = vehicle.place(point.lat, point.lon)
    vehicle.at = (*home, vehicle.ground_m)
    if speed is not None:
        vehicle.speed = speed
    for number in unrolled(mission, laps):
        item = mission.items[number]
        if item.command == 20:
            vehicle.go((*home, vehicle.at[2]))
            vehicle.go((*home, vehicle.ground_m))
        elif item.command in (16, 17, 18, 19, 21, 22, 82, 31, 94):
            here = not item.x and not item.y
            place = vehicle.at[:2] if here or (ardupilot and item.command == 22) else vehicle.plane(item)
            height = vehicle.height(item)
            if ardupilot and item.z == 0 and item.command not in (21, 22):
                height = vehicle.at[2]
            if item.command == 22:
                vehicle.go((*vehicle.at[:2], height))
            elif item.command == 21:
                vehicle.go((*place, vehicle.at[2]))
            vehicle.go((*place, height))
            if item.command in (16, 19, 82):
                vehicle.stay(max(item.params[0], 0.0))
        else:
            vehicle.order(item)
    return vehicle


def assert_same_work(
    mission, flights, grounds_m, *, laps=1, speed=5.0, ardupilot=False, forgets=False, tolerance_m=1.0
):
    """The flights take the pictures of the mission where it takes them, and fly its way with what it holds there.

    `grounds_m`: what each flight's home lies above that of the mission. `forgets`: the camera forgets, at each change of battery,
    where it took its last picture.
    """
    point = mission.home.point
    origin = (point.lat, point.lon)
    before = fly(mission, Vehicle(origin), laps=laps, speed=speed, ardupilot=ardupilot)
    after = Vehicle(origin)
    for flight, ground in zip(flights, grounds_m, strict=True):
        after.ground_m, after.held, after.every_m, after.every_s = ground, {}, 0.0, 0.0
        if forgets:
            after.last_picture = None
        fly(flight, after, speed=speed, ardupilot=ardupilot)
    assert len(after.pictures) == len(before.pictures)
    for theirs, ours in zip(before.pictures, after.pictures, strict=True):
        assert math.dist(theirs[:2], ours[:2]) <= tolerance_m
        assert abs(theirs[2] - ours[2]) <= 0.2
    assert after.events == before.events
    position = 0
    for place, state in before.track[:: round(4 / STEP_M)]:
        if place[2] <= 1.0:
            continue  # taking off, landing
        while position < len(after.track):
            here, held = after.track[position]
            near = math.dist(place[:2], here[:2]) <= tolerance_m and abs(place[2] - here[2]) <= 1.0
            if near and held == state:
                break
            position += 1
        assert position < len(after.track), (place, state)
    return before, after

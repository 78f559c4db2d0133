"""Things for the second renderer, modelled a second time and differently: nothing is shared with the Rust models.

Every function takes a `random.Random` and returns mesh objects that lie on z = 0 around the origin, in millimetres.
"""

import math

from shapes import ball, blob, box, cone, cut, material, rod, tube


def metal(rng):
    """Steel, brass, black oxide."""
    grey = rng.uniform(0.25, 0.75)
    colour = rng.choice([(grey, grey, grey)] * 3 + [(0.6, 0.42, 0.16), (0.05, 0.05, 0.055)])
    return material(rng, colour, True, rng.uniform(0.12, 0.5), rng.choice([0, 0, 0.1]))


def colour(rng):
    """A colour of tools and cables, linear RGB."""
    return rng.choice(
        [(0.01, 0.01, 0.012), (0.5, 0.02, 0.02), (0.02, 0.08, 0.4), (0.7, 0.45, 0.02), (0.7, 0.18, 0.01),
         (0.02, 0.25, 0.05), (0.6, 0.6, 0.6), (0.15, 0.15, 0.15), (0.3, 0.02, 0.3)]
    )  # fmt: skip


def plastic(rng, base=None):
    """Plastic of a colour."""
    return material(rng, base or colour(rng), False, rng.uniform(0.2, 0.6))


def skin(rng):
    """Skin from light to dark."""
    tone = rng.choice([(0.75, 0.46, 0.34), (0.58, 0.32, 0.21), (0.36, 0.17, 0.1), (0.15, 0.07, 0.04), (0.07, 0.03, 0.02)])
    return material(rng, tone, False, rng.uniform(0.4, 0.6), 0.05)


def cloth(rng):
    """Work clothes."""
    tone = rng.choice([(0.02, 0.04, 0.12), (0.03, 0.03, 0.03), (0.2, 0.18, 0.13), (0.75, 0.2, 0.01), (0.25, 0.25, 0.27)])
    return material(rng, tone, False, 0.9, rng.uniform(0.1, 0.5))


def bolt(rng):
    steel, d = metal(rng), rng.choice([5, 6, 8, 10, 12, 16])
    length, wide, high = d * rng.uniform(2, 6), d * 0.9, d * rng.uniform(0.6, 1.0)
    hexagon = rng.random() < 0.6
    head = rod(wide, high, (0, 0, wide * 0.87), "x", steel, 6 if hexagon else 32)
    if not hexagon:
        head = cut(head, rod(d * 0.45, d * 0.6, (-high / 2, 0, wide * 0.87), "x", steel, 6))
    axis = wide * 0.87
    parts = [head, rod(d / 2 * 0.93, length, (high / 2 + length / 2, 0, axis), "x", steel)]
    rings = int(length * rng.uniform(0.5, 1.0) / (d * 0.17))
    for ring in range(rings):
        x = high / 2 + length - (ring + 0.5) * d * 0.17
        parts.append(cone(d / 2, d / 2 * 0.85, d * 0.12, (x, 0, axis), "x", steel, 20))
    return parts


def nut(rng):
    steel, d = metal(rng), rng.choice([5, 6, 8, 10, 12, 16, 20])
    high = d * rng.uniform(0.55, 0.9)
    sides = rng.choice([6, 6, 6, 4])
    body = rod(d * (0.93 if sides == 6 else 1.15), high, (0, 0, high / 2), "z", steel, sides)
    parts = [cut(body, rod(d * 0.48, high * 3, (0, 0, high / 2), "z", steel, 28))]
    if rng.random() < 0.3:
        flange = rod(d * 1.15, d * 0.16, (0, 0, d * 0.08), "z", steel)
        parts.append(cut(flange, rod(d * 0.48, d, (0, 0, 0), "z", steel, 28)))
    return parts


def washer(rng):
    steel, hole = metal(rng), rng.uniform(2.5, 9)
    outer, thick = hole * rng.uniform(1.7, 3.0), max(0.9, hole * rng.uniform(0.2, 0.4))
    body = rod(outer, thick, (0, 0, thick / 2), "z", steel, 48)
    tools = [rod(hole, thick * 4, (0, 0, 0), "z", steel, 40)]
    if rng.random() < 0.25:
        tools.append(box((outer, outer * 0.14, thick * 4), (outer, 0, 0), steel))
    return [cut(body, *tools)]


def connector(rng):
    body, gold = plastic(rng), material(rng, (0.7, 0.48, 0.12), True, 0.3)
    kind = rng.randrange(4)
    if kind == 0:  # a block with wires' holes, screw terminal
        poles, pitch = rng.randint(2, 7), rng.choice([3.8, 5.0])
        green = plastic(rng, rng.choice([(0.02, 0.3, 0.06), (0.02, 0.1, 0.4), (0.02, 0.02, 0.02)]))
        long = poles * pitch
        shell = box((pitch * 2, long, pitch * 2.2), (0, 0, pitch * 1.1), green, 0.3)
        holes = [box((pitch, pitch * 0.6, pitch * 0.7), (pitch, (i + 0.5) * pitch - long / 2, pitch * 0.7), green) for i in range(poles)]
        shell = cut(shell, *holes)
        screws = [rod(pitch * 0.33, 0.8, (-pitch * 0.2, (i + 0.5) * pitch - long / 2, pitch * 2.2), "z", metal(rng), 20) for i in range(poles)]
        return [shell, *screws]
    if kind == 1:  # a housing with pins and a latch
        wide, high, long = rng.uniform(8, 28), rng.uniform(6, 14), rng.uniform(12, 26)
        pins = [
            box((6, 0.9, 0.9), (long / 2 + 2, y * 2.5 - wide * 0.3, z * 2.5 + high * 0.35), gold)
            for y in range(max(2, int(wide * 0.6 / 2.5))) for z in range(2)
        ]  # fmt: skip
        latch = box((long * 0.4, wide * 0.3, 1.5), (0, 0, high + 0.7), body, 0.3)
        cable = tube([(-long / 2, 0, high / 2), (-long, 3, high / 3), (-long * 1.8, rng.uniform(-12, 12), 2.5)], 2.5, plastic(rng))
        return [box((long, wide, high), (0, 0, high / 2), body, 0.8), latch, cable, *pins]
    if kind == 2:  # USB or the like
        steel = metal(rng)
        shell = cut(box((14, 12, 4.5), (12, 0, 3.4), steel, 0.3), box((14, 11, 3.6), (13, 0, 3.4), steel))
        cable = tube([(-12, 0, 3.4), (-24, 2, 2.5), (-45, rng.uniform(-20, 20), 2.2)], 2.0, body)
        return [shell, box((22, 15, 7), (-5, 0, 3.5), body, 1.5), cable]
    r = rng.uniform(5, 10)  # round, with a collar
    steel = metal(rng)
    ring = cut(rod(r, r * 1.6, (0, 0, r), "x", steel, 24), rod(r * 0.75, r, (r * 0.6, 0, r), "x", steel, 24))
    back = cone(r * 0.9, r * 0.55, r * 2.4, (-r * 1.9, 0, r), "x", body, 28)
    cable = tube([(-r * 3, 0, r), (-r * 5, 0, r * 0.6), (-r * 8, rng.uniform(-r, r) * 2, r * 0.4)], r * 0.4, body)
    return [ring, back, cable, *[rod(r * 0.08, r, (r * 0.3, r * 0.4 * math.cos(a), r + r * 0.4 * math.sin(a)), "x", gold, 12) for a in (0, 2.1, 4.2)]]


def wire(rng):
    radius, paint = rng.uniform(0.8, 4.0), plastic(rng)
    if rng.random() < 0.3:  # a coil
        ring, turns = radius * rng.uniform(10, 22), rng.uniform(1.5, 3.5)
        points = []
        for step in range(int(turns * 12)):
            a = step / 12 * 2 * math.pi
            r = ring * (1 + 0.06 * math.sin(a * 0.7))
            points.append((r * math.cos(a), r * math.sin(a), radius * (1 + 1.5 * (step // 12))))
        return [tube(points, radius, paint)]
    heading, at, points = rng.uniform(0, 6.28), [0.0, 0.0], []
    step = radius * rng.uniform(7, 14)
    for _ in range(rng.randint(6, 11)):
        points.append((at[0], at[1], radius))
        heading += rng.gauss(0, 0.5)
        at = [at[0] + step * math.cos(heading), at[1] + step * math.sin(heading)]
    middle = [sum(p[i] for p in points) / len(points) for i in (0, 1)]
    points = [(x - middle[0], y - middle[1], z) for x, y, z in points]
    parts = [tube(points, radius, paint)]
    if rng.random() < 0.6:
        copper = material(rng, (0.7, 0.32, 0.18), True, 0.3)
        for end, before in ((points[0], points[1]), (points[-1], points[-2])):
            out = [(a - b) / step for a, b in zip(end, before)]
            parts.append(tube([end, tuple(a + o * radius * 5 for a, o in zip(end, out))], radius * 0.5, copper, smooth=False))
    return parts


def screwdriver(rng):
    r, grip, blade, thick = rng.uniform(9, 17), rng.uniform(70, 115), rng.uniform(60, 160), rng.uniform(2, 4)
    handle, steel = plastic(rng), metal(rng)
    body = rod(r, grip, (-grip / 2, 0, r), "x", handle, rng.choice([6, 8, 32]))
    parts = [body, cone(r * 0.9, r * 0.5, 12, (5, 0, r), "x", plastic(rng)), ball((r * 0.5, r * 0.98, r * 0.98), (-grip, 0, r), handle)]
    parts.append(rod(thick, blade, (10 + blade / 2, 0, r), "x", steel, 24))
    if rng.random() < 0.5:
        parts.append(box((9, thick * 2.6, 1.2), (12 + blade, 0, r), steel, 0.2))
    else:
        parts.append(cone(thick, 0.4, 8, (14 + blade, 0, r), "x", steel, 4))
    return parts


def wrench(rng):
    steel, flats = metal(rng), rng.uniform(9, 26)
    length, thick = flats * rng.uniform(7, 11), max(3.5, flats * 0.38)
    z = thick / 2
    bar = box((length, flats * 0.75, thick * 0.8), (0, 0, z), steel, thick * 0.25)
    parts = [bar]
    for side in (-1, 1):
        x = side * length / 2
        head = rod(flats * 0.95, thick, (x, 0, z), "z", steel, 40)
        if side < 0 and rng.random() < 0.55:
            parts.append(cut(head, rod(flats * 0.56, thick * 3, (x, 0, z), "z", steel, rng.choice([6, 12]))))
        else:
            slot = box((flats * 1.6, flats, thick * 3), (x + side * flats * 0.85, 0, z), steel, 0, side * rng.uniform(0, 0.26))
            parts.append(cut(head, slot))
    return parts


def marker(rng):
    r, length = rng.uniform(4.5, 10), rng.uniform(95, 145)
    ink, body = plastic(rng), plastic(rng, rng.choice([None, (0.7, 0.7, 0.7), (0.02, 0.02, 0.02)]))
    part = length * rng.uniform(0.25, 0.38)
    parts = [rod(r, length - part, (-(length - part) / 2, 0, r), "x", body), rod(r * 1.02, 6, (-(length - part) + 4, 0, r), "x", ink)]
    if rng.random() < 0.7:
        parts.append(cone(r * 1.08, r * rng.uniform(0.85, 1.05), part, (part / 2, 0, r), "x", ink))
        if rng.random() < 0.6:
            parts.append(box((part * 0.8, r * 0.4, 1.5), (part * 0.4, 0, 2 * r + 1.2), ink, 0.4))
    else:
        parts.append(cone(r * 0.9, r * 0.45, part * 0.4, (part * 0.2, 0, r), "x", body))
        parts.append(cone(r * 0.35, r * 0.2, 7, (part * 0.4 + 3, 0, r), "x", ink))
    return parts


def zip_tie(rng):
    tone = rng.choice([(0.01, 0.01, 0.01), (0.75, 0.72, 0.66), (0.75, 0.72, 0.66), None])
    nylon, wide = plastic(rng, tone), rng.uniform(2.8, 8)
    length, z = wide * rng.uniform(26, 42), wide / 2
    kind = rng.randrange(3)
    if kind == 0:
        strap = box((length, wide, 1.3), (length / 2, 0, 0.9), nylon)
        tail = box((wide * 2, wide * 0.5, 1.1), (length + wide, 0, 0.9), nylon)
        return [strap, tail, cut(box((wide * 1.6, wide * 1.5, wide * 0.9), (0, 0, wide * 0.45), nylon, 0.4), box((wide * 0.6, wide * 0.9, wide * 3), (0, 0, 0), nylon))]
    points, ring = [], length / 6.28 * rng.uniform(0.5, 0.85)
    if kind == 1:
        for step in range(19):
            a = step / 18 * 2 * math.pi
            points.append((ring * math.sin(a), ring - ring * math.cos(a), z))
        out = rng.uniform(10, 60)
        points += [(out * 0.5, -3, z), (out, -out * 0.25, z)]
    else:
        bend = rng.uniform(0.2, 2.5)
        for step in range(13):
            a = bend * step / 12
            r = length / bend
            points.append((r * math.sin(a), r - r * math.cos(a), z))
    head = box((wide * 1.5, wide * 0.9, wide * 1.2), (0, 0, wide * 0.6), nylon, 0.4)
    return [tube(points, 0, nylon, flat=(wide, 1.2)), head]


def allen_key(rng):
    steel, flats = metal(rng), rng.uniform(2.5, 10)
    long, short, bend = flats * rng.uniform(10, 20) + 20, flats * rng.uniform(4, 8) + 8, flats * 1.5
    points = [(-long, 0, flats / 2), (-bend, 0, flats / 2)]
    points += [(-bend + bend * math.sin(a), bend - bend * math.cos(a), flats / 2) for a in (0.4, 0.8, 1.2, 1.5708)]
    points.append((0, short, flats / 2))
    parts = [tube(points, flats * 0.55, steel, smooth=False)]
    if rng.random() < 0.2:
        parts = [rod(flats * 0.55, long, (long / 2, 0, 8), "x", steel, 6), box((12, 75, 16), (0, 0, 8), plastic(rng), 5)]
    return parts


def _chain(points, radii, step=0.35):
    """Lumps along a line of points."""
    lumps = []
    for (a, b), (ra, rb) in zip(zip(points, points[1:]), zip(radii, radii[1:])):
        count = max(2, int(math.dist(a, b) / (step * (ra + rb))))
        for i in range(count + 1):
            t = i / count
            lumps.append((tuple(p + (q - p) * t for p, q in zip(a, b)), ra + (rb - ra) * t))
    return lumps


def hand(rng):
    paint = skin(rng) if rng.random() < 0.75 else cloth(rng)
    side, curl = rng.choice([-1, 1]), rng.choice([0.0, 0.15, 0.4, 1.0])
    lumps = _chain([(10, -22, 16), (75, -24, 16)], [17, 15]) + _chain([(10, 0, 17), (80, 0, 16)], [18, 15]) + _chain([(10, 22, 16), (75, 24, 16)], [17, 15])
    for y, reach in ((-30, 58), (-10, 76), (11, 82), (31, 72)):
        at, heading, points = (84.0, float(y), 15.0), -0.02, [(84.0, float(y), 15.0)]
        for share in (0.45, 0.3, 0.25):
            heading -= curl
            at = (at[0] + reach * share * math.cos(heading), at[1] * 1.03, max(9.0, at[2] + reach * share * math.sin(heading) * 0.6 + 4 * curl))
            points.append(at)
        lumps += _chain(points, [9.5, 9, 8.5, 8])
    lumps += _chain([(20, side * 34, 16), (52, side * 58, 13), (78, side * 68, 11)], [14, 11, 9])
    parts = [blob(lumps, paint, 3.0)]
    arm = rng.choice([0, 60, 150, 230])
    if arm:
        sleeve = cloth(rng) if rng.random() < 0.5 else paint
        parts.append(blob(_chain([(12, 0, 19), (-30, 0, 24)], [21, 25]), paint, 4.0))
        parts.append(blob(_chain([(-20, 0, 27), (-arm, 0, 34)], [28, 36]), sleeve, 5.0))
    return parts


def foot(rng):
    paint = plastic(rng) if rng.random() < 0.75 else skin(rng)
    long = rng.uniform(230, 300)
    lumps = [((0.36 * long, 0, 30), 38), ((0.2 * long, 0, 36), 42), ((0.02 * long, 0, 44), 40), ((-0.18 * long, 0, 46), 38), ((-0.3 * long, 0, 40), 38)]
    lumps += _chain([(-0.22 * long, 0, 60), (-0.25 * long, 0, 120)], [36, 34])
    parts = [blob(lumps, paint, 5.0)]
    if rng.random() < 0.6:
        sole = box((long, 92, 18), (0.03 * long, 0, 9), plastic(rng, rng.choice([(0.01, 0.01, 0.01), (0.7, 0.7, 0.7)])), 8)
        parts.append(sole)
    if rng.random() < 0.6:
        parts.append(cone(58, 62, 150, (-0.25 * long, 0, 175), "z", cloth(rng)))
    return parts


def leg(rng):
    paint = cloth(rng) if rng.random() < 0.8 else skin(rng)
    kind = rng.randrange(3)
    if kind == 0:  # a knee on the floor, the thigh above it
        lumps = _chain([(0, 0, 60), (rng.uniform(-120, 120), rng.uniform(-50, 50), 380)], [60, 82])
        return [blob(lumps, paint, 8.0)]
    if kind == 1:  # kneeling
        lumps = _chain([(0, 0, 62), (-340, 0, 52)], [62, 50]) + _chain([(0, 0, 62), (40, 0, 330)], [64, 84])
        return [blob(lumps, paint, 8.0)]
    lumps = _chain([(-60, 0, 80), (-60, rng.uniform(-60, 60), 430)], [55, 66])
    shoe = blob([((90, 0, 30), 36), ((45, 0, 36), 40), ((-10, 0, 42), 40), ((-60, 0, 45), 40)], plastic(rng), 6.0)
    return [blob(lumps, paint, 8.0), shoe]


def person(rng):
    shirt, bare = cloth(rng), skin(rng)
    if rng.random() < 0.5:  # an arm
        bend = rng.uniform(-0.8, 0.8)
        wrist = (220 * math.cos(bend), 220 * math.sin(bend), 28)
        tip = (400 * math.cos(bend), 400 * math.sin(bend), 20)
        return [
            blob(_chain([(-280, 0, 58), (0, 0, 44)], [60, 46]), shirt, 7.0),
            blob(_chain([(0, 0, 42), wrist, tip], [40, 28, 24]), bare, 6.0),
        ]  # fmt: skip
    body = [blob(_chain([(-250, 0, 110), (180, 0, 110)], [135, 150]), shirt, 14.0), ball((115, 80, 95), (410, 0, 95), bare)]
    for side in (-1, 1):
        body.append(blob(_chain([(170, side * 150, 80), (0, side * 280, 50), (-200, side * 300, 40)], [62, 48, 36]), shirt, 9.0))
        body.append(blob(_chain([(-300, side * 85, 90), (-700, side * 130, 80), (-1050, side * 140, 60)], [88, 66, 52]), cloth(rng), 10.0))
    return body


def clutter(rng):
    """Something that no class names."""
    kind = rng.randrange(4)
    if kind == 0:
        size = [rng.uniform(40, 200) for _ in range(3)]
        return [box(size, (0, 0, size[2] / 2), plastic(rng, rng.choice([(0.45, 0.28, 0.13), None])), 1.0)]
    if kind == 1:
        r = rng.uniform(12, 40)
        return [rod(r, rng.uniform(60, 250), (0, 0, r), "x", metal(rng))]
    if kind == 2:
        return [cone(60, 12, 220, (0, 0, 120), "z", plastic(rng, (0.8, 0.15, 0.01))), box((150, 150, 14), (0, 0, 7), plastic(rng, (0.8, 0.15, 0.01)), 3)]
    r = rng.uniform(20, 60)
    return [cut(rod(r, r * 0.5, (0, 0, r * 0.25), "z", plastic(rng)), rod(r * 0.6, r * 2, (0, 0, 0), "z", plastic(rng)))]


CLASSES = {
    "bolt": (bolt, 45), "nut": (nut, 20), "washer": (washer, 24), "connector": (connector, 45), "wire": (wire, 140),
    "screwdriver": (screwdriver, 220), "wrench": (wrench, 190), "marker": (marker, 130), "zip_tie": (zip_tie, 130),
    "allen_key": (allen_key, 100), "hand": (hand, 260), "foot": (foot, 290), "leg": (leg, 420), "person": (person, 900),
}  # fmt: skip
"""Name of a class: what makes it, and about how long it is, mm."""
HUMAN = {"hand", "foot", "leg", "person"}

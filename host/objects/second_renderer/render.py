"""Renders a small test set with another renderer and other models, to measure how far a detector trained on the Rust
pictures carries: Blender/Cycles through the Python package `bpy`.

Blender is GPL software: it is a tool that is run, not shipped and not linked. In a virtual environment of its own:

    python3.11 -m venv venv && venv/bin/pip install bpy==4.5.15
    venv/bin/python render.py --out DIR/test_second_renderer --count 150 --seed 1

Writes DIR/images/*.jpg, DIR/labels/*.txt (YOLO), DIR/annotations.json (COCO). Boxes come from a line of sight through
every pixel, not from the picture. Resumable: a picture whose truth file exists is not rendered again.
"""

import argparse
import json
import math
import os
import random
import sys

import bpy
from mathutils import Vector

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import things  # noqa: E402
from shapes import UNIT  # noqa: E402

NAMES = list(things.CLASSES)
LEAST_VISIBLE = 0.25
"""A thing of which less lies in the picture is left out of the truth; people are kept if a few pixels show them."""


def floor_material(rng):
    """Concrete, tiles, wood, epoxy, checker, from Blender's own textures."""
    made = bpy.data.materials.new("floor")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface, place = nodes["Principled BSDF"], nodes.new("ShaderNodeTexCoord")
    surface.inputs["Roughness"].default_value = rng.choice([rng.uniform(0.08, 0.3), rng.uniform(0.4, 0.95)])
    grey = rng.uniform(0.06, 0.5)
    tint = [grey * rng.uniform(0.85, 1.15) for _ in range(3)]
    if rng.random() < 0.2:
        tint = rng.choice([(0.06, 0.2, 0.12), (0.1, 0.15, 0.3), (0.35, 0.12, 0.08), (0.4, 0.34, 0.2)])
    dark = [c * rng.uniform(0.3, 0.85) for c in tint]
    kind = rng.choice(["noise", "noise", "brick", "wave", "checker", "voronoi", "plain"])
    if kind == "plain":
        surface.inputs["Base Color"].default_value = (*tint, 1.0)
        return made
    node = nodes.new({"noise": "ShaderNodeTexNoise", "brick": "ShaderNodeTexBrick", "wave": "ShaderNodeTexWave",
                      "checker": "ShaderNodeTexChecker", "voronoi": "ShaderNodeTexVoronoi"}[kind])  # fmt: skip
    links.new(place.outputs["Object"], node.inputs["Vector"])
    if kind in ("brick", "checker"):
        node.inputs["Scale"].default_value = rng.uniform(0.15, 0.8)
        node.inputs["Color1"].default_value = (*tint, 1.0)
        node.inputs["Color2"].default_value = (*[c * rng.uniform(0.8, 1.0) for c in tint], 1.0)
        if kind == "brick":
            node.offset = rng.choice([0.0, 0.5])
            node.inputs["Mortar"].default_value = (*dark, 1.0)
            node.inputs["Mortar Size"].default_value = rng.uniform(0.005, 0.02)
            node.inputs["Brick Width"].default_value = rng.choice([0.5, 1.0, 2.0])
        links.new(node.outputs["Color"], surface.inputs["Base Color"])
        return made
    node.inputs["Scale"].default_value = {"noise": rng.uniform(0.3, 3), "wave": rng.uniform(0.5, 2), "voronoi": rng.uniform(3, 12)}[kind]
    if kind in ("noise", "wave"):
        node.inputs["Detail"].default_value = 8
        if kind == "wave":
            node.inputs["Distortion"].default_value = rng.uniform(3, 12)
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color = (*dark, 1.0)
    ramp.color_ramp.elements[1].color = (*tint, 1.0)
    links.new(node.outputs["Distance" if kind == "voronoi" else "Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], surface.inputs["Base Color"])
    return made


def light(rng):
    """A surround and one to three lamps."""
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    world.use_nodes = True
    grey = rng.uniform(0.05, 0.9)
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (grey * rng.uniform(0.85, 1.1), grey, grey * rng.uniform(0.9, 1.2), 1.0)
    for _ in range(rng.randint(1, 3)):
        sun = rng.random() < 0.3
        lamp = bpy.data.lights.new("lamp", "SUN" if sun else "AREA")
        thing = bpy.data.objects.new("lamp", lamp)
        bpy.context.scene.collection.objects.link(thing)
        toward = Vector((rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(0.5, 1.6))).normalized()
        thing.location = toward * 18
        thing.rotation_euler = (-toward).to_track_quat("-Z", "Y").to_euler()
        if sun:
            lamp.energy, lamp.angle = rng.uniform(1.0, 4.0), rng.uniform(0.01, 0.2)
        else:
            lamp.energy, lamp.size = rng.uniform(600, 3500), rng.uniform(0.5, 9)


def camera(rng, scale, size):
    """Looks at the origin: low and outward as a robot's camera, obliquely, or straight down."""
    data = bpy.data.cameras.new("camera")
    thing = bpy.data.objects.new("camera", data)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.scene.camera = thing
    data.sensor_width, data.lens = 36.0, rng.uniform(26, 70)
    focal = size[0] * data.lens / data.sensor_width
    elevation = rng.choice([rng.uniform(0.4, 0.8), rng.uniform(0.7, 1.3), rng.uniform(1.35, 1.56)])
    azimuth, far = rng.uniform(0, 6.28), max(scale * focal, 80) * UNIT
    thing.location = (far * math.cos(elevation) * math.cos(azimuth), far * math.cos(elevation) * math.sin(azimuth), far * math.sin(elevation))
    thing.rotation_euler = (-thing.location).to_track_quat("-Z", "Y").to_euler()
    data.clip_start, data.clip_end = 0.01, 500
    return thing


def reach_of(parts):
    """The smallest and largest x and y of some objects, Blender units."""
    corners = [part.matrix_world @ vertex.co for part in parts for vertex in part.data.vertices]
    return [f(c[i] for c in corners) for i in (0, 1) for f in (min, max)]


def put(rng, name, make, spot, taken):
    """Makes a thing and puts it at a free place near `spot`; none if there is no room."""
    parts = make(rng)
    turn = rng.uniform(0, 6.28)
    holder = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(holder)
    for part in parts:
        part.parent = holder
        part["thing"] = holder.name
    for _ in range(12):
        x, y = spot()
        holder.location, holder.rotation_euler = (x, y, 0), (0, 0, turn)
        bpy.context.view_layer.update()
        left, right, low, high = reach_of(parts)
        if all(right < a or left > b or high < c or low > d for a, b, c, d in taken):
            taken.append((left, right, low, high))
            return holder, parts
    for part in parts:
        bpy.data.objects.remove(part)
    bpy.data.objects.remove(holder)
    return None


def look(view, size):
    """For every thing the box of the pixels whose lines of sight meet it first, and their number."""
    scene, graph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    frame = [view.matrix_world @ corner for corner in view.data.view_frame(scene=scene)]
    upper_right, lower_right, _, upper_left = frame
    across, down, eye = (upper_right - upper_left) / size[0], (lower_right - upper_right) / size[1], view.matrix_world.translation
    seen = {}
    for v in range(size[1]):
        for u in range(size[0]):
            toward = (upper_left + across * (u + 0.5) + down * (v + 0.5)) - eye
            hit, _, _, _, thing, _ = scene.ray_cast(graph, eye, toward.normalized())
            name = thing.get("thing") if hit else None
            if name:
                box = seen.setdefault(name, [u, v, u, v, 0])
                box[0], box[1], box[2], box[3] = min(box[0], u), min(box[1], v), max(box[2], u), max(box[3], v)
                box[4] += 1
    return seen


def inside(view, parts, size):
    """The share of a thing's corners that the picture frames."""
    from bpy_extras.object_utils import world_to_camera_view

    scene, count, total = bpy.context.scene, 0, 0
    for part in parts:
        for vertex in list(part.data.vertices)[:: max(1, len(part.data.vertices) // 300)]:
            at = world_to_camera_view(scene, view, part.matrix_world @ vertex.co)
            total += 1
            count += 0 <= at.x <= 1 and 0 <= at.y <= 1 and at.z > 0
    return count / max(total, 1)


def picture(out, number, seed, samples):
    """Renders one picture and returns its truth."""
    rng = random.Random(f"{seed}/{number}")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    size = rng.choice([(288, 288), (320, 240), (352, 272), (384, 224)])
    # Before anything is looked at: the lines of sight depend on it.
    settings = bpy.context.scene.render
    settings.resolution_x, settings.resolution_y, settings.resolution_percentage = *size, 100
    focus = NAMES[number % len(NAMES)]
    human = focus in things.HUMAN
    short = min(size)
    wanted = short * math.exp(rng.uniform(math.log(0.3 if human else 0.09), math.log(1.2 if human else 0.75)))
    scale = min(max(things.CLASSES[focus][1] / wanted, 0.15), 4.0)
    view = camera(rng, scale, size)
    light(rng)
    bpy.ops.mesh.primitive_plane_add(size=400)
    bpy.context.object.data.materials.append(floor_material(rng))
    span = scale * UNIT

    def spot():
        return rng.uniform(-0.5, 0.5) * size[0] * span, rng.uniform(-0.5, 0.5) * size[1] * span

    taken, placed = [], []
    count = 0 if rng.random() < 0.05 else rng.choice([1, 2, 3, 3, 4, 5, 6])
    for place in range(count):
        name = focus if place == 0 else rng.choice(NAMES)
        pixels = things.CLASSES[name][1] / scale
        if place > 0 and not 14 < pixels < 1.1 * short:
            continue
        found = put(rng, name, things.CLASSES[name][0], spot, taken)
        if found:
            placed.append((name, *found))
    if rng.random() < 0.3 and 120 / scale < short:
        put(rng, "clutter", things.clutter, spot, taken)
    bpy.context.view_layer.update()
    seen, objects = look(view, size), []
    for name, holder, parts in placed:
        box = seen.get(holder.name)
        if not box or max(box[2] - box[0], box[3] - box[1]) < 5:
            continue
        if inside(view, parts, size) < LEAST_VISIBLE and not (name in things.HUMAN and box[4] > 250):
            continue
        objects.append({"class": name, "bbox": [box[0], box[1], box[2] - box[0] + 1, box[3] - box[1] + 1], "area": box[4]})
    path = os.path.join(out, "images", f"{number:06}.jpg")
    render(rng, path, samples)
    return {"number": number, "width": size[0], "height": size[1], "objects": objects}


def render(rng, path, samples):
    """Renders the scene to a JPEG."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", samples, True
    scene.cycles.max_bounces = 5
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.view_settings.view_transform = rng.choice(["Standard", "Filmic", "AgX"])
    scene.view_settings.exposure = rng.uniform(-0.7, 0.8)
    scene.render.image_settings.file_format, scene.render.image_settings.quality = "JPEG", rng.randint(75, 96)
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)


def write(out, truths):
    """COCO and YOLO files of all pictures."""
    images, annotations = [], []
    for truth in truths:
        width, height, lines = truth["width"], truth["height"], []
        images.append({"id": truth["number"] + 1, "file_name": f"{truth['number']:06}.jpg", "width": width, "height": height})
        for thing in truth["objects"]:
            x, y, w, h = thing["bbox"]
            place = NAMES.index(thing["class"])
            lines.append(f"{place} {(x + w / 2) / width:.6f} {(y + h / 2) / height:.6f} {w / width:.6f} {h / height:.6f}\n")
            annotations.append(
                {"id": len(annotations) + 1, "image_id": truth["number"] + 1, "category_id": place + 1, "bbox": [x, y, w, h],
                 "area": thing["area"], "iscrowd": 0, "segmentation": []}
            )  # fmt: skip
        with open(os.path.join(out, "labels", f"{truth['number']:06}.txt"), "w", encoding="utf-8") as file:
            file.writelines(lines)
    categories = [{"id": i + 1, "name": n, "supercategory": "human" if n in things.HUMAN else "item"} for i, n in enumerate(NAMES)]
    info = {"description": f"nearfield objects, second renderer: Blender {bpy.app.version_string}"}
    with open(os.path.join(out, "annotations.json"), "w", encoding="utf-8") as file:
        json.dump({"info": info, "images": images, "annotations": annotations, "categories": categories}, file, indent=1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, help="folder to write to")
    parser.add_argument("--count", type=int, default=150, help="pictures")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--samples", type=int, default=32, help="light paths per pixel")
    arguments = parser.parse_args()
    for part in ("images", "labels", "truth"):
        os.makedirs(os.path.join(arguments.out, part), exist_ok=True)
    truths = []
    for number in range(arguments.count):
        path = os.path.join(arguments.out, "truth", f"{number:06}.json")
        if os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                truths.append(json.load(file))
            continue
        truth = picture(arguments.out, number, arguments.seed, arguments.samples)
        with open(path, "w", encoding="utf-8") as file:
            json.dump(truth, file)
        truths.append(truth)
        print(f"{number + 1} of {arguments.count}", file=sys.stderr)
    write(arguments.out, truths)


if __name__ == "__main__":
    main()

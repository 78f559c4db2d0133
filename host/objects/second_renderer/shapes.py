"""Shapes and materials for the second renderer: thin helpers over Blender's Python module.

Lengths are millimetres; one Blender unit is 100 mm. Every helper returns a mesh object that is linked to the scene.
"""

import math

import bmesh
import bpy
from mathutils import Matrix, Vector

UNIT = 0.01
"""Blender units per millimetre."""


def material(rng, colour, metal=False, roughness=0.5, bump=0.0):
    """A principled material; `colour` is linear RGB, `bump` the strength of fine noise."""
    made = bpy.data.materials.new("material")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    surface = nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = (*colour, 1.0)
    surface.inputs["Metallic"].default_value = 1.0 if metal else 0.0
    surface.inputs["Roughness"].default_value = roughness
    if bump > 0:
        noise = nodes.new("ShaderNodeTexNoise")
        noise.inputs["Scale"].default_value = rng.uniform(4, 40)
        hills = nodes.new("ShaderNodeBump")
        hills.inputs["Strength"].default_value = bump
        links.new(noise.outputs["Fac"], hills.inputs["Height"])
        links.new(hills.outputs["Normal"], surface.inputs["Normal"])
    return made


def _object(name, mesh, paint):
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    if paint is not None:
        mesh.materials.clear()
        mesh.materials.append(paint)
    return made


def _from_bmesh(shape, paint, smooth):
    mesh = bpy.data.meshes.new("mesh")
    for face in shape.faces:
        face.smooth = smooth
    shape.to_mesh(mesh)
    shape.free()
    return _object("part", mesh, paint)


def _turn(axis):
    return {"x": Matrix.Rotation(math.pi / 2, 4, "Y"), "y": Matrix.Rotation(math.pi / 2, 4, "X"), "z": Matrix()}[axis]


def cone(low, high, length, at, axis, paint, sides=32):
    """A frustum around an axis, its middle at `at`. A cylinder has low = high; six sides make a hexagon."""
    shape = bmesh.new()
    bmesh.ops.create_cone(
        shape, cap_ends=True, segments=sides, radius1=low * UNIT, radius2=max(high, 0.01) * UNIT, depth=length * UNIT
    )
    bmesh.ops.transform(shape, matrix=Matrix.Translation(Vector(at) * UNIT) @ _turn(axis), verts=shape.verts)
    return _from_bmesh(shape, paint, smooth=False)


def rod(radius, length, at, axis, paint, sides=32):
    """A cylinder."""
    return cone(radius, radius, length, at, axis, paint, sides)


def box(size, at, paint, bevel=0.0, turn=0.0):
    """A box by its full sizes, turned around z."""
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=1.0)
    bmesh.ops.scale(shape, vec=Vector(size) * UNIT, verts=shape.verts)
    if bevel > 0:
        bmesh.ops.bevel(shape, geom=shape.edges[:], offset=bevel * UNIT, segments=3, affect="EDGES", profile=0.5)
    place = Matrix.Translation(Vector(at) * UNIT) @ Matrix.Rotation(turn, 4, "Z")
    bmesh.ops.transform(shape, matrix=place, verts=shape.verts)
    return _from_bmesh(shape, paint, smooth=False)


def ball(half, at, paint):
    """An ellipsoid by its half axes."""
    shape = bmesh.new()
    bmesh.ops.create_uvsphere(shape, u_segments=32, v_segments=20, radius=1.0)
    bmesh.ops.scale(shape, vec=Vector(half) * UNIT, verts=shape.verts)
    bmesh.ops.translate(shape, vec=Vector(at) * UNIT, verts=shape.verts)
    return _from_bmesh(shape, paint, smooth=True)


def _as_mesh(thing, paint):
    """The evaluated mesh of a curve or metaball as an object of its own; the original goes away."""
    bpy.context.view_layer.update()
    view = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(view)
    for face in mesh.polygons:
        face.use_smooth = True
    bpy.data.objects.remove(thing)
    return _object("part", mesh, paint)


def tube(points, radius, paint, flat=None, smooth=True):
    """A tube through points; `flat` = (width, thickness) makes a strap on its edge instead; `smooth` rounds the path."""
    curve = bpy.data.curves.new("curve", "CURVE")
    curve.dimensions = "3D"
    line = curve.splines.new("BEZIER" if smooth else "POLY")
    places = line.bezier_points if smooth else line.points
    places.add(len(points) - 1)
    for place, point in zip(places, points):
        at = [v * UNIT for v in point]
        if smooth:
            place.co = at
            place.handle_left_type = place.handle_right_type = "AUTO"
        else:
            place.co = (*at, 1.0)
    if flat:
        curve.extrude = flat[0] / 2 * UNIT
        curve.bevel_depth = flat[1] / 2 * UNIT
        curve.twist_mode = "Z_UP"
    else:
        curve.bevel_depth = radius * UNIT
        curve.bevel_resolution = 5
        curve.use_fill_caps = True
    thing = bpy.data.objects.new("curve", curve)
    bpy.context.scene.collection.objects.link(thing)
    return _as_mesh(thing, paint)


def blob(lumps, paint, resolution=4.0):
    """Metaballs run together: `lumps` is a list of ((x, y, z), radius)."""
    meta = bpy.data.metaballs.new("meta")
    meta.resolution = resolution * UNIT
    meta.threshold = 0.6
    for at, radius in lumps:
        lump = meta.elements.new()
        lump.co = [v * UNIT for v in at]
        # A single metaball shows at about 0.57 of its nominal radius at this threshold.
        lump.radius = radius * UNIT / 0.57
    thing = bpy.data.objects.new("meta", meta)
    bpy.context.scene.collection.objects.link(thing)
    return _as_mesh(thing, paint)


def cut(body, *tools):
    """Takes tools away from a body; the tools go away."""
    for tool in tools:
        modifier = body.modifiers.new("cut", "BOOLEAN")
        modifier.operation, modifier.object, modifier.solver = "DIFFERENCE", tool, "EXACT"
    bpy.context.view_layer.update()
    view = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(view)
    body.modifiers.clear()
    body.data = mesh
    for tool in tools:
        bpy.data.objects.remove(tool)
    return body

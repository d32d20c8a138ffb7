"""Shader nodes of a :class:`.surfaces.Surface`: a pattern of colours and relief, and a finish."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import bpy
import numpy as np

from .surfaces import Colour, Surface


class Pattern(NamedTuple):
    """Node sockets of colour and height; the colour may be constant, the height absent."""

    colour: Any
    height: Any = None


class Graph:
    """Builder of a node tree from values and sockets."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        tree.nodes.clear()

    def add(self, kind: str, inputs: dict[Any, Any] | None = None, **settings) -> Any:
        """Add a node; sockets are linked and values set by input name or index."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in (inputs or {}).items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[name])
            else:
                node.inputs[name].default_value = value
        return node

    def math(self, operation: str, *values) -> Any:
        """Apply an arithmetic operation to one or two numbers."""
        return self.add("Math", dict(enumerate(values)), operation=operation).outputs[0]

    def ramp(self, factor, stops: list[tuple[float, Colour]], constant: bool = False) -> Any:
        """Map a number from 0 to 1 to colours."""
        node = self.add("ValToRGB", {0: factor})
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(1.0)
        for element, (place, colour) in zip(elements, stops, strict=True):
            element.position, element.color = place, (*colour, 1.0)
        node.color_ramp.interpolation = "CONSTANT" if constant else "LINEAR"
        return node.outputs[0]

    def noise(self, at, scale: float, detail: float = 2.0, distortion: float = 0.0) -> Any:
        """Add fractal noise around 0.5."""
        inputs = {"Vector": at, "Scale": scale, "Detail": detail, "Distortion": distortion}
        return self.add("TexNoise", inputs).outputs[0]

    def wave(self, at, scale: float, distortion: float = 0.0, **settings) -> Any:
        """Add bands across x with values from 0 to 1."""
        inputs = {"Vector": at, "Scale": scale, "Distortion": distortion, "Detail": 3.0}
        return self.add("TexWave", inputs, **settings).outputs[1]

    def voronoi(self, at, scale: float, feature: str = "F1", randomness: float = 1.0) -> Any:
        """Add the node of a Voronoi cell texture."""
        inputs = {"Vector": at, "Scale": scale, "Randomness": randomness}
        return self.add("TexVoronoi", inputs, feature=feature)

    def stretch(self, at, scale: Colour, rotation: Colour = (0.0, 0.0, 0.0)) -> Any:
        """Scale coordinates, then rotate them."""
        inputs = {"Vector": at, "Scale": scale, "Rotation": rotation}
        return self.add("Mapping", inputs).outputs[0]

    def mix(self, factor, first, second) -> Any:
        """Blend two colours."""
        return self.add("MixRGB", {0: factor, 1: _rgba(first), 2: _rgba(second)}).outputs[0]


def material(surface: Surface) -> bpy.types.Material:
    """Return the Blender material of a surface."""
    result = bpy.data.materials.new(surface.pattern)
    result.use_nodes = True
    graph = Graph(result.node_tree)
    rng = np.random.default_rng(surface.seed)
    # One unit of a pattern's coordinates is the surface's scale.
    coordinates = graph.add("TexCoord").outputs["Object"]
    size = 1.0 / surface.scale
    mapping = graph.add("Mapping", {"Vector": coordinates, "Scale": (size, size, size)})
    mapping.inputs["Location"].default_value = rng.uniform(-50.0, 50.0, 3)
    pattern = PATTERNS[surface.pattern](graph, mapping.outputs[0], surface.colours, rng)
    shader = graph.add(
        "BsdfPrincipled", {"Base Color": _rgba(pattern.colour), "Roughness": surface.roughness}
    )
    if pattern.height is not None and surface.bump > 0.0:
        bump = graph.add("Bump", {"Distance": surface.bump, "Height": pattern.height})
        graph.tree.links.new(bump.outputs[0], shader.inputs["Normal"])
    for name, value in FINISHES[surface.finish].items():
        shader.inputs[name].default_value = value
    output = shader.outputs[0]
    if surface.finish == "coated":
        # The surface's roughness is that of the clear coat.
        shader.inputs["Coat Roughness"].default_value = surface.roughness
    if surface.finish == "leaf":
        through = graph.add("BsdfTranslucent", {"Color": _rgba(pattern.colour)}).outputs[0]
        output = graph.add("MixShader", {0: 0.35, 1: output, 2: through}).outputs[0]
    graph.add("OutputMaterial", {"Surface": output})
    return result


def _rgba(colour):
    return colour if isinstance(colour, bpy.types.NodeSocket) else (*colour, 1.0)


def _plain(graph: Graph, at, colours, rng) -> Pattern:
    return Pattern(colours[0])


def _mottled(graph: Graph, at, colours, rng) -> Pattern:
    noise = graph.noise(at, 1.0, 8.0, rng.uniform(0.0, 0.8))
    stops = [(0.36, colours[1]), (0.5, colours[0]), (0.64, colours[-1])]
    return Pattern(graph.ramp(noise, stops), graph.noise(at, 4.0, 8.0))


def _grainy(graph: Graph, at, colours, rng) -> Pattern:
    noise = graph.noise(at, 1.0, 3.0)
    mild = tuple(0.75 * channel for channel in colours[0])
    return Pattern(graph.ramp(noise, [(0.35, mild), (0.65, colours[0])]), noise)


def _speckle(graph: Graph, at, colours, rng) -> Pattern:
    noise = graph.noise(at, 3.0, 2.0)
    place = rng.uniform(0.56, 0.64)
    stops = [(0.0, colours[0]), (place, colours[0]), (place + 0.03, colours[1])]
    return Pattern(graph.ramp(noise, stops), noise)


def _marble(graph: Graph, at, colours, rng) -> Pattern:
    veins = graph.wave(at, 0.25, 12.0, wave_profile="SAW")
    cloud = graph.noise(at, 0.7, 8.0, 1.5)
    base = graph.ramp(cloud, [(0.3, colours[2]), (0.6, colours[0])])
    return Pattern(graph.mix(graph.ramp(veins, _PULSE), base, colours[1]))


def _wood(graph: Graph, at, colours, rng) -> Pattern:
    along = graph.stretch(at, (0.12, 1.0, 1.0), (0.0, 0.1, 0.05))
    rings = graph.wave(along, 0.5, 6.0, bands_direction="Y")
    fibres = graph.noise(graph.stretch(at, (0.5, 14.0, 14.0)), 1.0, 4.0)
    base = graph.ramp(rings, [(0.0, colours[1]), (0.5, colours[0]), (1.0, colours[2])])
    return Pattern(graph.mix(graph.ramp(fibres, _CONTRAST), base, colours[1]), fibres)


def _planks(graph: Graph, at, colours, rng) -> Pattern:
    boards = _brick(graph, at, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 9.0, 1.0, 0.012)
    shade = boards.outputs[0]
    shifted = graph.add("VectorMath", {0: at, 1: shade}, operation="ADD").outputs[0]
    grain = _wood(graph, graph.stretch(shifted, (0.5, 3.0, 3.0)), colours, rng)
    tinted = graph.mix(
        graph.ramp(shade, [(0.0, (0.0,) * 3), (1.0, (0.45,) * 3)]), grain.colour, colours[1]
    )
    dark = tuple(0.15 * channel for channel in colours[1])
    height = graph.math("SUBTRACT", grain.height, boards.outputs[1])
    return Pattern(graph.mix(boards.outputs[1], tinted, dark), height)


def _bricks(graph: Graph, at, colours, rng) -> Pattern:
    wall = _brick(graph, at, colours[0], colours[1], 3.0, 1.0, 0.1)
    noise = graph.noise(at, 2.5, 8.0)
    worn = graph.mix(graph.ramp(noise, _CONTRAST), wall.outputs[0], colours[1])
    height = graph.math("SUBTRACT", graph.math("MULTIPLY", noise, 0.4), wall.outputs[1])
    return Pattern(graph.mix(wall.outputs[1], worn, colours[2]), height)


def _tiles(graph: Graph, at, colours, rng) -> Pattern:
    tiles = _brick(graph, at, colours[0], colours[1], 1.0, 1.0, 0.03, offset=0.0)
    cloud = graph.ramp(graph.noise(at, 1.5, 8.0, 1.0), [(0.3, (0.0,) * 3), (0.7, (0.35,) * 3)])
    glazed = graph.mix(cloud, tiles.outputs[0], colours[1])
    height = graph.math("SUBTRACT", 1.0, tiles.outputs[1])
    return Pattern(graph.mix(tiles.outputs[1], glazed, colours[2]), height)


def _brick(graph: Graph, at, first, second, width, height, mortar, offset=0.5) -> Any:
    inputs = {
        **{"Vector": at, "Color1": _rgba(first), "Color2": _rgba(second), "Scale": 1.0},
        **{"Mortar Size": mortar, "Mortar Smooth": 0.1, "Bias": 0.0},
        **{"Brick Width": width, "Row Height": height},
    }
    return graph.add("TexBrick", inputs, offset=offset)


def _checks(graph: Graph, at, colours, rng) -> Pattern:
    inputs = {"Vector": at, "Color1": _rgba(colours[0]), "Color2": _rgba(colours[1]), "Scale": 1.0}
    checks = graph.add("TexChecker", inputs).outputs[0]
    cloud = graph.ramp(graph.noise(at, 1.3, 8.0), [(0.3, (0.0,) * 3), (0.75, (0.3,) * 3)])
    return Pattern(graph.mix(cloud, checks, colours[-1]), graph.noise(at, 3.0, 6.0))


def _stripes(graph: Graph, at, colours, rng) -> Pattern:
    turned = graph.stretch(at, (1.0, 1.0, 1.0), (0.0, 0.0, rng.choice([0.0, 0.8, 1.5708])))
    wave = graph.wave(turned, 0.3)
    stops = [(0.0, colours[0]), (0.45, colours[1]), (0.8, colours[-1])]
    return Pattern(graph.ramp(wave, stops, constant=True), graph.noise(at, 20.0, 2.0))


def _bands(graph: Graph, at, colours, rng) -> Pattern:
    level = graph.add("SeparateXYZ", {0: at}).outputs[2]
    noise = graph.noise(graph.add("CombineXYZ", {2: level}).outputs[0], 1.0, 1.0)
    edges = np.sort(rng.uniform(0.3, 0.7, 4))
    picked = [colours[k % len(colours)] for k in range(5)]
    stops = list(zip((0.0, *edges), picked, strict=True))
    return Pattern(graph.ramp(noise, stops, constant=True), graph.noise(at, 3.0, 4.0))


def _plaid(graph: Graph, at, colours, rng) -> Pattern:
    across = graph.ramp(graph.wave(at, 0.3), [(0.0, (0.0,) * 3), (0.6, (0.7,) * 3)], constant=True)
    along = graph.ramp(
        graph.wave(at, 0.3, bands_direction="Y"), [(0.0, (0.0,) * 3), (0.6, (0.7,) * 3)], True
    )
    base = graph.mix(across, colours[0], colours[1])
    return Pattern(graph.mix(along, base, colours[-1]), graph.noise(at, 20.0, 2.0))


def _dots(graph: Graph, at, colours, rng) -> Pattern:
    distance = graph.voronoi(at, 0.7, randomness=rng.choice([0.0, 0.6, 1.0])).outputs["Distance"]
    size = rng.uniform(0.2, 0.38)
    stops = [(0.0, colours[1]), (size, colours[1]), (size + 0.02, colours[0])]
    return Pattern(graph.ramp(distance, stops), graph.noise(at, 6.0, 4.0))


def _cells(graph: Graph, at, colours, rng) -> Pattern:
    tint = graph.voronoi(at, 1.0).outputs["Color"]
    edge = graph.voronoi(at, 1.0, "DISTANCE_TO_EDGE").outputs["Distance"]
    level = graph.add("SeparateXYZ", {0: tint}).outputs[0]
    stops = [(k / len(colours), colour) for k, colour in enumerate(colours)]
    lines = graph.ramp(edge, [(0.03, (1.0,) * 3), (0.06, (0.0,) * 3)])
    dark = tuple(0.2 * channel for channel in colours[0])
    return Pattern(graph.mix(lines, graph.ramp(level, stops, constant=True), dark), edge)


def _terrazzo(graph: Graph, at, colours, rng) -> Pattern:
    tint = graph.voronoi(at, 2.5).outputs["Color"]
    level = graph.add("SeparateXYZ", {0: tint}).outputs[0]
    stops = [(0.0, colours[0]), (0.6, colours[-1]), (0.8, colours[1])]
    chips = graph.ramp(level, stops, constant=True)
    edge = graph.voronoi(at, 2.5, "DISTANCE_TO_EDGE").outputs["Distance"]
    inside = graph.ramp(edge, [(0.06, (0.0,) * 3), (0.1, (1.0,) * 3)])
    return Pattern(graph.mix(inside, colours[0], chips))


def _weave(graph: Graph, at, colours, rng) -> Pattern:
    across, along = graph.wave(at, 0.3), graph.wave(at, 0.3, bands_direction="Y")
    threads = graph.math("MULTIPLY", across, along)
    shade = graph.noise(at, 0.1, 4.0)
    cloth = graph.ramp(shade, [(0.3, colours[0]), (0.7, colours[1])])
    dark = tuple(0.3 * channel for channel in colours[0])
    return Pattern(
        graph.mix(graph.ramp(threads, [(0.0, (0.0,) * 3), (0.5, (1.0,) * 3)]), dark, cloth), threads
    )


def _text(graph: Graph, at, colours, rng) -> Pattern:
    words = _brick(graph, at, (0.0,) * 3, (1.0,) * 3, 2.3, 1.0, 0.25)
    ink = graph.ramp(words.outputs[0], [(0.0, (1.0,) * 3), (0.75, (0.0,) * 3)], constant=True)
    between = graph.math("SUBTRACT", 1.0, words.outputs[1])
    letters = graph.ramp(graph.noise(at, 5.0, 1.0), [(0.4, (0.0,) * 3), (0.5, (1.0,) * 3)])
    printed = graph.math("MULTIPLY", graph.math("MULTIPLY", ink, between), letters)
    return Pattern(graph.mix(printed, colours[0], colours[1]))


def _abstract(graph: Graph, at, colours, rng) -> Pattern:
    noise = graph.noise(at, 0.8, rng.uniform(0.0, 3.0), rng.uniform(0.0, 2.5))
    places = np.sort(rng.uniform(0.3, 0.7, len(colours) - 1))
    stops = list(zip((0.0, *places), colours, strict=True))
    fine = graph.noise(at, 10.0, 5.0)
    painted = graph.ramp(noise, stops, constant=True)
    return Pattern(graph.mix(graph.ramp(fine, _CONTRAST), painted, colours[0]), fine)


def _map(graph: Graph, at, colours, rng) -> Pattern:
    noise = graph.noise(at, 0.8, 10.0, 0.3)
    stops = [(0.0, colours[0]), (0.5, colours[1]), (0.56, colours[2]), (0.64, colours[-1])]
    return Pattern(graph.ramp(noise, stops, constant=True))


def _rings(graph: Graph, at, colours, rng) -> Pattern:
    wave = graph.wave(at, 0.25, 2.0, wave_type="RINGS", rings_direction="SPHERICAL")
    stops = [(0.0, colours[0]), (0.4, colours[1]), (0.8, colours[-1])]
    return Pattern(graph.ramp(wave, stops), wave)


def _brushed(graph: Graph, at, colours, rng) -> Pattern:
    lines = graph.noise(graph.stretch(at, (0.3, 0.3, 25.0)), 1.0, 4.0)
    return Pattern(graph.ramp(lines, [(0.3, colours[1]), (0.7, colours[0])]), lines)


def _hammered(graph: Graph, at, colours, rng) -> Pattern:
    return Pattern(colours[0], graph.voronoi(at, 1.5, "SMOOTH_F1").outputs["Distance"])


def _veins(graph: Graph, at, colours, rng) -> Pattern:
    # The mesh of a leaf extends along x with its rib at y = 0. Object coordinates keep the rib
    # there; the random offset of the pattern would move it.
    place = graph.add("TexCoord").outputs["Object"]
    x, y, _ = graph.add("SeparateXYZ", {0: place}).outputs
    side = graph.math("ABSOLUTE", y)
    along = graph.add("CombineXYZ", {0: graph.math("SUBTRACT", x, side)}).outputs[0]
    veins = graph.ramp(graph.wave(along, 60.0, 0.5), _PULSE)
    cloud = graph.noise(at, 1.0, 4.0)
    base = graph.ramp(cloud, [(0.35, colours[0]), (0.65, tuple(0.7 * c for c in colours[0]))])
    weak = graph.math("MULTIPLY", veins, 0.5)
    return Pattern(graph.mix(weak, base, colours[1]), cloud)


_PULSE = [(0.0, (1.0,) * 3), (0.04, (0.6,) * 3), (0.15, (0.0,) * 3)]
_CONTRAST = [(0.4, (0.0,) * 3), (0.7, (0.7,) * 3)]

PATTERNS: dict[str, Callable[..., Pattern]] = {
    make.__name__[1:]: make
    for make in (
        _abstract,
        _bands,
        _bricks,
        _brushed,
        _cells,
        _checks,
        _dots,
        _grainy,
        _hammered,
        _map,
        _marble,
        _mottled,
        _plaid,
        _plain,
        _planks,
        _rings,
        _speckle,
        _stripes,
        _terrazzo,
        _text,
        _tiles,
        _veins,
        _weave,
        _wood,
    )
}

FINISHES: dict[str, dict[str, float]] = {
    "matt": {"Specular IOR Level": 0.25},
    "plastic": {},
    "coated": {"Coat Weight": 0.6, "Roughness": 0.6},
    "metal": {"Metallic": 1.0},
    "cloth": {"Specular IOR Level": 0.1, "Sheen Weight": 0.4},
    "wax": {"Subsurface Weight": 0.8, "Subsurface Scale": 0.01},
    "glass": {"Transmission Weight": 1.0, "IOR": 1.45},
    "leaf": {},
}
"""Inputs of the principled shader for each finish, in addition to colour and roughness."""

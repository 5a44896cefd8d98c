"""What is inside instances gets points from a class that all instances of a prototype inherit.

No layer can say anything of the prims inside an instance, but any can let it inherit a class: what
that says of them counts, and the instances share one prototype as before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from pxr import Sdf, Usd, UsdUtils

from meshmark.usd.diagnostics import caught
from meshmark.usd.points import MeshPoints, StagePoints

NAME = "_meshmark"
ANYTHING = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)


@dataclass(frozen=True, eq=False)
class Classes:
    """The classes of an override layer, one for each prototype that holds marked meshes.

    Parameters
    ----------
    root : Sdf.Path
        Of the class that holds them; its name is that of no root prim of the source.
    of : mapping of Sdf.Path to Sdf.Path
        Where in the class of each prototype things are said: in it, or in a variant of it.
    prototypes : mapping of Sdf.Path to Sdf.Path
        Of each instance: one inside another has a path in the prototype of that.
    places : mapping of Sdf.Path to Sdf.Path
        Of instances that are to inherit their class in variants of what is around them only.
    sets : mapping of Sdf.Path to tuple of str
        Names of all sets of variants that classes with variants are to have, in order.
    """

    root: Sdf.Path = Sdf.Path.emptyPath
    of: Mapping[Sdf.Path, Sdf.Path] = field(default_factory=dict)
    prototypes: Mapping[Sdf.Path, Sdf.Path] = field(default_factory=dict)
    places: Mapping[Sdf.Path, Sdf.Path] = field(default_factory=dict)
    sets: Mapping[Sdf.Path, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def for_prims(cls, stage: Usd.Stage, prims: Iterable[Usd.Prim], source: str) -> Classes:
        """Plan those of some prims inside instances of a stage, the file of which is `source`."""
        every = Usd.PrimRange(stage.GetPseudoRoot(), ANYTHING)
        # In the order of the stage: how prototypes are numbered is another each time.
        known = dict.fromkeys(prim.GetPrototype() for prim in every if prim.IsInstance())
        instances = {
            prototype.GetPath(): [each.GetPath() for each in prototype.GetInstances()]
            for prototype in known
        }
        around = {
            path: {_first(each) for each in found if _first(each) in instances}
            for path, found in instances.items()
        }
        needed = {_first(prim.GetPrimInPrototype().GetPath()) for prim in prims}
        while more := {outer for path in needed for outer in around[path]} - needed:
            needed |= more
        root = Sdf.Path.absoluteRootPath.AppendChild(_free_name(source))
        chosen = [path for path in instances if path in needed]
        return cls(
            root,
            {path: root.AppendChild(f"_{i}") for i, path in enumerate(chosen, 1)},
            {each: path for path in chosen for each in instances[path]},
        )

    def spec(self, prim: Usd.Prim) -> Sdf.Path:
        """Return where in the layer things are said of a prim inside an instance."""
        return self._in_class(prim.GetPrimInPrototype().GetPath())

    @property
    def links(self) -> dict[Sdf.Path, Sdf.Path]:
        """Class that each instance inherits, by where in the layer it says so; sorted."""
        found = {
            self.places.get(instance, self._in_class(instance)): self.of[prototype]
            for instance, prototype in self.prototypes.items()
        }
        return {place: found[place].StripAllVariantSelections() for place in sorted(found)}

    def shown(self, stage: Usd.Stage, prims: Iterable[Usd.Prim]) -> dict[Sdf.Path, list[Usd.Prim]]:
        """Map each instance that is inside no other to those prims in it that show what some do."""
        wanted = {prim.GetPrimInPrototype().GetPath() for prim in prims}
        outermost = sorted(path for path in self.prototypes if _first(path) not in self.of)
        return {
            path: [
                prim
                for prim in Usd.PrimRange(stage.GetPrimAtPath(path), ANYTHING)
                if prim.IsInstanceProxy() and prim.GetPrimInPrototype().GetPath() in wanted
            ]
            for path in outermost
        }

    def in_variants(self, instance: Usd.Prim, selections: Iterable[tuple[str, str]]) -> Classes:
        """Say things of an instance, and of all that share its prototype, in variants of it."""
        prototype = self.prototypes[instance.GetPath()]
        own = place = self.of[prototype].StripAllVariantSelections()
        for name, variant in selections:
            place = place.AppendVariantSelection(name, variant)
        names = tuple(instance.GetVariantSets().GetNames())
        return replace(self, of={**self.of, prototype: place}, sets={**self.sets, own: names})

    def linked_at(self, instance: Sdf.Path, place: Sdf.Path) -> Classes:
        """Let an instance inherit its class in another spec, such as that in a variant."""
        return replace(self, places={**self.places, instance: place})

    def _in_class(self, path: Sdf.Path) -> Sdf.Path:
        """Take a path in a prototype into its class; others stay."""
        prototype = _first(path)
        return path.ReplacePrefix(prototype, self.of[prototype]) if prototype in self.of else path


def sharing(points: StagePoints, prims: Iterable[Usd.Prim]) -> dict[str, list[str]]:
    """Map each mesh inside an instance to all that show the same points, itself among them.

    To none, if their points are not the same, because a rig poses each in its own way.
    """
    groups: dict[Sdf.Path, list[Usd.Prim]] = {}
    for prim in prims:
        if prim.IsInstanceProxy():
            groups.setdefault(prim.GetPrimInPrototype().GetPath(), []).append(prim)
    found: dict[str, list[str]] = {}
    for group in groups.values():
        paths = [str(prim.GetPath()) for prim in group]
        alike = len(group) == 1 or _posed_alike([points.of(prim) for prim in group])
        found |= dict.fromkeys(paths, paths if alike else [])
    return found


def _posed_alike(group: list[MeshPoints]) -> bool:
    """Tell whether no rig poses meshes of a prototype, or one that is inside it altogether."""
    posed = set()
    for each in group:
        if each.rig is None:
            posed.add(("", ""))
            continue
        animation = each.rig.skeleton.GetAnimQuery()
        bone = _shared(each.rig.bone)
        if _first(bone) != _first(_shared(each.prim)):
            return False
        posed.add((str(bone), str(_shared(animation.GetPrim())) if animation else ""))
    return len(posed) == 1


def _shared(prim: Usd.Prim) -> Sdf.Path:
    """Return the path of a prim; inside an instance, that in its prototype."""
    return (prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath()


def _first(path: Sdf.Path) -> Sdf.Path:
    """Return what a path begins with: in a prototype, that of the prototype."""
    return path.GetPrefixes()[0]


def _free_name(source: str) -> str:
    """Return a name that no layer of a source has at its root.

    A class of that name would be another's: one layer may lie over what another marked.
    """
    with caught(source):
        layers = UsdUtils.ComputeAllDependencies(source)[0]
    taken = {prim.name for layer in layers for prim in layer.rootPrims}
    name, n = NAME, 2
    while name in taken:
        name, n = f"{NAME}_{n}", n + 1
    return name

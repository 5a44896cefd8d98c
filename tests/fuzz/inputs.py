"""The inputs of a campaign: what is altered, and which commands it goes through."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from random import Random

from .archives import altered_archive, altered_json, altered_members, json_text, packed, unpacked
from .crates import altered_crate
from .evidence import altered_evidence
from .gltf import altered_gltf
from .seeds import QUICK, STORE, Seed
from .stores import altered_store
from .texts import altered_text, words_of

# Kinds, and how many of a hundred inputs are of it.
SHARES = {
    "usda": 20,
    "usdc": 24,
    "usdz": 10,
    "obj": 12,
    "gltf": 14,
    "evidence": 8,
    "store": 4,
    "key": 2,
    "names": 3,
    "manifest": 3,
}
SCHEMES = ("apex", "cho2007", "tsai2014")
ALLOWING = ((), ("--allow-unmarked", "all"), ("--keep-metadata",))
OUTSIDE = "../outside/kept"

USD_WORDS = [
    *words_of(
        """half3[] float3[] double3[] point3f[] point3d[] point3h[] normal3f[] color4f[] quatf[] int
        int64 uint uchar bool half float double string token asset matrix4d timecode[] int[] None
        true def over class Mesh Points Xform Scope SkelRoot Cube NurbsPatch BasisCurves
        PointInstancer rel uniform varying custom points points.timeSamples points.connect
        faceVertexCounts faceVertexIndices xformOp:scale xformOpOrder extent subdivisionScheme
        visibility purpose primvars:st primvars:points interpolation payload references inherits
        specializes variants variantSet subLayers instanceable active kind clips offset scale delete
        append timeCodesPerSecond metersPerUnit framesPerSecond upAxis defaultPrim elementSize
        customData ( ) [ ] { } = , ; : "A" "" "look" "one" "\n" <> </> </A> </World> </World/Own>
        <../A> <.points> </A.points> @@ @.@ @./composed.usda@ @body.usda@ @lod.usda@ @sub.usda@
        @clips.usda@ @gone.usda@ @a.usdz[b.usda]@ @anon:1@ @/dev/zero@ @/etc/passwd@ @k@
        @x.<UDIM>.png@ @C:\\x.usda@ @.usda@ @http://0.0.0.0/x.usda@ @../outside/kept@"""
    ),
    *(b"1: None", b"(0, 0, 0)", b"[]", b"{}", b"@" + b"x" * 300 + b"@"),
]
OBJ_WORDS = [
    *words_of(
        """v vt vn f l p o g s usemtl mtllib vp curv \\ / // 1/ /1 1/1 1//1 1/1/1 1/1/1/1 -1 0 9999
        -9999 1.5 /3 //3 1/2/ # nan"""
    ),
    *(b"\n", b"\nf 1 2\n", b"\nv 1 2\n", b"\nv 1 2 3 4 5 6 7\n", b"\\\n"),
]
NAME_WORDS = [*words_of("acme @names @ # Mu\u0308ller - -- \ufeffacme"), b" ", b"\n"]
KEY_WORDS = [*words_of("meshmark-key-1 meshmark-key-2"), b"\n", b" ", b"0" * 64, b"f" * 32]
MEMBERS = [
    *("lod.usda", "lod.usdc", "x.usda", "x.usdc", "x.txt", "k", "a/b/c.usda", "x.usdz", "CON.usdc"),
    *("../x.usdc", OUTSIDE, "/etc/motd", "C:\\x.usdc", "./x.usdc", "a//b.usdc", ".", "..", ""),
    *(" ", "\n.usdc", "x" * 300 + ".usdc", "\xe9.usdc", "a/" * 100 + "x.usdc", "x\0y.usdc"),
]


@dataclass(frozen=True)
class Input:
    """Files and the commands run on them, in a folder of their own.

    Parameters
    ----------
    index : int
        Its number within the campaign.
    kind : str
        Kind of the file that was altered.
    seed : str
        Name of what it was made from.
    altered : str
        Name of the file that was altered.
    files : dict
        Content by name; a key file `k` is always there.
    commands : tuple
        Arguments of one command each.
    """

    index: int
    kind: str
    seed: str
    altered: str
    files: dict[str, bytes]
    commands: tuple[tuple[str, ...], ...]

    def with_content(self, content: bytes) -> Input:
        """Return the same with another content of the altered file."""
        return replace(self, files={**self.files, self.altered: content})


def make_input(seeds: dict[str, list[Seed]], seed: int, index: int, kinds: Sequence[str]) -> Input:
    """Make input `index` of the campaign of a seed; the same again whenever it is asked for."""
    rng = Random(f"{seed}/{index}")
    kind = rng.choices(kinds, [SHARES[kind] for kind in kinds])[0]
    chosen = rng.choice(seeds[kind])
    names = list(chosen.files)
    if kind in ("key", "names", "manifest", "evidence", "store"):
        altered = names[-1]
    else:
        altered = names[0] if rng.random() < 0.6 else rng.choice(names)
    content = ALTER[kind](chosen.files[altered], rng)
    files = {**chosen.files, altered: content}
    return Input(index, kind, chosen.name, altered, files, _commands(kind, chosen, rng))


def _usdz(data: bytes, rng: Random) -> bytes:
    if rng.random() < 0.25:
        return altered_archive(data, rng)

    def alter(name: str, content: bytes) -> bytes:
        return (altered_crate if name.endswith(".usdc") else _usda)(content, rng)

    members = altered_members(unpacked(data), rng, MEMBERS, alter)
    method = 8 if rng.random() < 0.05 else 0
    return packed(members, method=method, aligned=rng.random() < 0.9)


def _usda(data: bytes, rng: Random) -> bytes:
    return altered_text(data, rng, USD_WORDS)


def _manifest(data: bytes, rng: Random) -> bytes:
    return json_text(altered_json(json.loads(data), rng), rng)


ALTER: dict[str, Callable[[bytes, Random], bytes]] = {
    "usda": _usda,
    "usdc": altered_crate,
    "usdz": _usdz,
    "obj": lambda data, rng: altered_text(data, rng, OBJ_WORDS),
    "gltf": altered_gltf,
    "evidence": altered_evidence,
    "store": altered_store,
    "key": lambda data, rng: altered_text(data, rng, KEY_WORDS),
    "names": lambda data, rng: altered_text(data, rng, NAME_WORDS),
    "manifest": _manifest,
}
assert list(ALTER) == list(SHARES)


def _commands(kind: str, seed: Seed, rng: Random) -> tuple[tuple[str, ...], ...]:
    key = ("--key", "k")
    source = "frames" if seed.source.startswith("frames/") else seed.source
    match kind:
        case "key":
            return (("verify", source, *key, "--frames", ":", *QUICK),)
        case "names":
            return (("verify", source, *key, "--recipient", "@names", *QUICK),)
        case "manifest":
            return (("check", source), ("verify", source, *key, "--frames", ":", *QUICK))
        case "evidence":
            recipe = QUICK if seed.name == "quick" else ()
            return (("verify", source, *key, "--evidence", list(seed.files)[-1], *recipe),)
        case "store":
            tried = ("try", "--store", STORE, *key)
            # What is kept is looked for, and measured again where it cannot be believed.
            again = ("verify", source, *key, "--store", STORE, *QUICK)
            return (tried,) if rng.random() < 0.7 else (tried, again, tried)
    scheme = rng.choices((QUICK, ("--scheme", "tsai2014"), ("--scheme", "apex")), (4, 2, 1))[0]
    look = ("inspect", source, *scheme)
    if kind == "gltf":
        return (look, *rng.choices(_gltf_uses(source, key, rng), (3, 2, 6, 6, 2, 2))[0])
    return (look, *rng.choices(_uses(source, key, rng), (8, 4, 1, 6, 8, 3, 1, 2, 2, 3))[0])


def _uses(source: str, key: tuple[str, ...], rng: Random) -> list[tuple[tuple[str, ...], ...]]:
    """Return what may be done with a source after a look at it."""
    output = "out" + rng.choice((".usda", ".usdc", ".usd"))
    verify, embed = ("verify", source, *key), ("embed", source, *key, "-o", output)
    evidence = (*verify, "--evidence", "e", *QUICK)
    again = ("verify", output, *key, *QUICK)
    return [
        ((*verify, "--frames", ":", *QUICK),),
        ((*verify, "--scheme", rng.choice(SCHEMES), "--frames", "auto"),),
        (verify,),
        ((*embed, *QUICK, "--recipient", "acme"), again),
        ((*embed, *QUICK, "--deliver", *rng.choice(ALLOWING)), ("check", output), again),
        (evidence, evidence),
        (("segment", source, "-o", "cut.usda"),),
        (("check", source, "--json"),),
        (("attack", "noise", source, "-o", output, "-p", "amplitude=0.001", "--seed", "1"),),
        (
            (*embed, *QUICK, "--report", "mark.html"),
            ("report", source, *key, *QUICK, "-o", "copy.html"),
        ),
    ]


def _gltf_uses(source: str, key: tuple[str, ...], rng: Random) -> list[tuple[tuple[str, ...], ...]]:
    """Return what may be done with a glTF file after a look at it."""
    output = "out" + rng.choice((".glb", ".glb", ".gltf"))
    verify, embed = ("verify", source, *key), ("embed", source, *key, *QUICK, "-o")
    attack = ("attack", "noise", source, "-o", output, "-p", "amplitude=0.001")
    again = ("verify", output, *key, *QUICK)
    return [
        ((*verify, "--frames", ":", *QUICK),),
        ((*embed, "out.usdc"), ("verify", "out.usdc", *key, *QUICK)),
        ((*embed, output), again),
        ((*embed, output, "--uncompress"), again),
        (attack, ("inspect", output)),
        ((*verify, "--fps", rng.choice(("1", "7", "1000")), *QUICK),),
    ]

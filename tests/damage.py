# SPDX-License-Identifier: MIT
"""Damaged files, drawn by chance but the same ones every time, from good ones that `save` wrote."""

from __future__ import annotations

import copy
import functools
import io
import json
import random
import warnings
import zipfile

import numpy as np
from saved_things import THINGS, names_in, path_of

import pipedyn as pp

NUMBERS = [0, -1, 3, 10**30, -(10**400), 0.9, -0.0, 1e308, 1e-320, True, None, "x", "", [], {}]
VALUES = [
    *(*NUMBERS, [[]]),
    *({"object": place} for place in (0, -1, 10**9, True, 1.0)),
    *({"number": word} for word in ("nan", "inf", "1")),
    *({"complex": parts} for parts in ([1.0, 2.0], [1.0])),
    *({"tuple": parts} for parts in ([], [1, "two", None])),
    *({"named": name, "parts": parts} for name, parts in (("Scales", [1.0]), ("Pipe", []))),
    *({"dict": pairs} for pairs in ([[[], 1]], [["a", 1], ["a", 2]])),
    *({"array": name} for name in ("array0", "../header")),
    {"error": "SystemExit", "args": {"tuple": []}},
    {"class": "Pipe", "fields": {}},
]
"""What takes the place of something in a header."""

DTYPES = ["<f4", ">f8", "<i8", "<i1", "<c16", "<c8", "|b1", "<U3", "<f8"]


def read(data):
    """Header and arrays of a good file."""
    with np.load(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files if name != "header"}
        return json.loads(str(file["header"])), arrays


def written(header, arrays):
    """A file with these, whose header may be a text."""
    text = header if isinstance(header, str) else json.dumps(header)
    stream = io.BytesIO()
    np.savez_compressed(stream, header=np.array(text), **arrays)
    return stream.getvalue()


def nodes(value, path=()):
    """Where there is something in a header."""
    yield path
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from nodes(value[key], (*path, key))


def at(header, path):
    for key in path:
        header = header[key]
    return header


# ------------------------------------------------------------------------------ kinds of damage


def flipped(data, chance):
    """One to four bits of the file are others."""
    changed = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def cut(data, chance):
    """The file ends early, or lacks a piece."""
    begin, end = sorted(chance.randrange(len(data)) for _ in range(2))
    return data[:begin] if chance.random() < 0.5 else data[:begin] + data[end:]


def overwritten(data, chance):
    """A piece of the file stands at another place, too."""
    begin, end = sorted(chance.randrange(len(data)) for _ in range(2))
    place = chance.randrange(len(data))
    return data[:place] + data[begin:end] + data[place + end - begin :]


def replaced(data, chance):
    """Something in the header is something else."""
    header, arrays = read(data)
    path = chance.choice([one for one in nodes(header) if one])
    at(header, path[:-1])[path[-1]] = copy.deepcopy(chance.choice(VALUES))
    return written(header, arrays)


def renumbered(data, chance):
    """A number in the header is another."""
    header, arrays = read(data)
    numbers = [
        one
        for one in nodes(header)
        if isinstance(at(header, one), int | float) and one[0] == "objects" and one[-1] != "object"
    ]
    if not numbers:
        return replaced(data, chance)
    path = chance.choice(numbers)
    number = at(header, path)
    other = chance.choice([-number, number * 0.9, number + 1, number * 1e9, *NUMBERS])
    at(header, path[:-1])[path[-1]] = other
    return written(header, arrays)


def lacking(data, chance):
    """Something in the header is missing, or is there twice."""
    header, arrays = read(data)
    path = chance.choice([one for one in nodes(header) if one])
    place = at(header, path[:-1])
    if isinstance(place, list) and chance.random() < 0.5:
        place.insert(path[-1], copy.deepcopy(place[path[-1]]))
    else:
        del place[path[-1]]
    return written(header, arrays)


@functools.cache
def known_names():
    """Names of classes that any of the good files has."""
    return sorted(set().union(*(names_in(path_of(name)) for name in THINGS)))


def exchanged(data, chance):
    """A class is another, an object stands where another was, or refers to another."""
    header, arrays = read(data)
    names = [*known_names(), "ValueError", "os.system", "Exception"]
    references = [one for one in nodes(header) if one and one[-1] in ("object", "array")]
    kinds = [
        one for one in nodes(header) if one and one[-1] in ("class", "parts", "error", "named")
    ]
    drawn, objects = chance.random(), header["objects"]
    if drawn < 0.4 and kinds:
        path = chance.choice(kinds)
        if isinstance(at(header, path), str):
            at(header, path[:-1])[path[-1]] = chance.choice(names)
    elif drawn < 0.8 and references:
        path = chance.choice(references)
        before = at(header, path)
        other = chance.randrange(len(objects) or 1)
        at(header, path[:-1])[path[-1]] = other if before != "array" else f"array{other}"
    elif objects:
        i, j = chance.randrange(len(objects)), chance.randrange(len(objects))
        objects[i], objects[j] = objects[j], objects[i]
    return written(header, arrays)


def reshaped(data, chance):
    """An array has another shape, another type or other numbers."""
    header, arrays = read(data)
    if not arrays:
        return replaced(data, chance)
    name = chance.choice(list(arrays))
    values, drawn = arrays[name], chance.random()
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        if drawn < 0.3:
            shapes = [values.ravel(), values[None], values.T, values[..., None], values[..., :-1]]
            shapes += [values[:0], values[1:], np.zeros(0), np.zeros((0, 3)), np.zeros(())]
            arrays[name] = chance.choice(shapes)
        elif drawn < 0.6 and values.dtype.kind != "U":
            arrays[name] = values.astype(chance.choice(DTYPES))
        elif values.size and values.dtype.kind in "fc":
            values = values.copy()
            other = chance.choice([np.nan, np.inf, -1.0, 0.0, 1e300, 7.0])
            values.flat[chance.randrange(values.size)] = other
            arrays[name] = values
        else:
            arrays[name] = 0.9 * values if values.dtype.kind in "iufc" else values[::-1]
    return written(header, arrays)


def retold(data, chance):
    """The text of the header is changed."""
    header, arrays = read(data)
    text = json.dumps(header)
    place = chance.randrange(len(text))
    deep = chance.choice(
        ["[" * 100_000, "[" * 5_000 + "]" * 5_000, '{"tuple": [' * 400 + "]}" * 400]
    )
    texts = [
        text[:place] + text[place + 1 :],
        text[:place] + chance.choice('{}[],:"0e9-\\u') + text[place:],
        text.replace("0.2", chance.choice(["1e999", "NaN", "-Infinity", "0.2.2", "9" * 6000])),
        text.replace('"root":', '"root": 1, "root":'),
        text.replace('"root": {', f'"root": {deep}, "other": {{'),
        text.replace(
            '"format": 1', f'"format": {chance.choice(["1.0", "0", "true", "-1", "[]", "2"])}'
        ),
        "",
        "[]",
        deep,
    ]
    return written(chance.choice(texts), arrays)


def repacked(data, chance):
    """Members are missing, renamed, there twice, of another file, or no arrays."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        members = [(one, file.read(one)) for one in file.namelist()]
    other = path_of(chance.choice(THINGS))
    with zipfile.ZipFile(other) as file:
        strange = [(one, file.read(one)) for one in file.namelist()]
    place = chance.randrange(len(members))
    name, inside = members[place]
    change = chance.choice(["lost", "twice", "renamed", "strange", "cut", "more", "text", "zeros"])
    changed = bytearray(inside)
    changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    if change == "lost":
        del members[place]
    elif change == "twice":
        members.append((name, inside))
    elif change == "renamed":
        members[place] = chance.choice(["array99.npy", "../x.npy", "header", "/"]), inside
    elif change == "strange":
        members[place] = name, chance.choice(strange)[1]
    elif change == "more":
        members.append(("more.npy", inside))
    else:
        replaced = {"cut": inside[:-8], "text": b"text", "zeros": inside + b"\0" * 64}
        members[place] = name, replaced.get(change, bytes(changed))
    packings = [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
    return zipped(members, chance.choice(packings))


def zipped(members, packing=zipfile.ZIP_DEFLATED):
    """An archive of names and bytes, a name maybe twice."""
    stream = io.BytesIO()
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(stream, "w", packing) as file:
        for name, inside in members:
            file.writestr(zipfile.ZipInfo(name), inside, packing)
    return stream.getvalue()


def misdescribed(data, chance):
    """The description of an array, before its numbers, is changed; its checksum is right."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        members = [(one, file.read(one)) for one in file.namelist()]
    place = chance.randrange(len(members))
    name, inside = members[place]
    changed = bytearray(inside)
    for _ in range(chance.randint(1, 3)):
        changed[chance.randrange(min(128, len(changed)))] = chance.choice(
            b"0123456789(),'<>|fUO\x00"
        )
    members[place] = name, bytes(changed)
    return zipped(members)


BYTES = (flipped, cut, overwritten)
"""Damage that checksums tell: what loads is what was saved."""

STRUCTURE = (replaced, renumbered, lacking, exchanged, reshaped, retold, repacked, misdescribed)
DAMAGE = BYTES + STRUCTURE


def cases(count, seed=0, kinds=DAMAGE):
    """So many damaged files: the name of the good one, the kind of damage, and the bytes."""
    chance = random.Random(seed)
    for number in range(count):
        name, damage = chance.choice(THINGS), kinds[number % len(kinds)]
        yield name, damage, damage(path_of(name).read_bytes(), chance)


def outcome(data, path):
    """What loading gives: the thing, or the exception."""
    path.write_bytes(data)
    try:
        return pp.load(path)
    except Exception as error:
        return error

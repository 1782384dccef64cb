"""Archives of version 1 as they were written once: every later version reads them, and this one writes the same bytes."""

import pytest

from gpszip.container.contents import one_group
from gpszip.container.reader import from_bytes
from gpszip.container.writer import to_bytes
from oracle import archives

VERSION_1 = {
    "lone": ("a75a0180780e000977616c6b73206f66206f6e6520747261636b09f44efe"),
    "named": ("a75a098078828097d9ec458290dfc04afd8fdfc04a0b1e0d9b0ad5ed199177616c6b739f4f6ff7"),
    "numbered": ("a75a29ff00000204060900032b08561c"),
    "degrees": ("a75ae99a1235d0968280b0b4f808de068b040604753030350000009ac9a012"),
    "layered": (
        "a75a1180780e00090400425a68393141592653597f6fda2700003b91804000200c0880200030c002a519a69148a469148a470bb9229c28483fb7ed13806e7886a9"
    ),
    "small": (
        "a75a3901171302010000000200000000175bca00d2496b0102000000020204000410000000000000000000000000000000000308000100"
        "77616c6b7305046b657074ef5e0e9b"
    ),
    "small layered": (
        "a75ab901061080780e000902020400032d000100425a683931415926535912ce35480000020180200c088020002186819a0c5371772453"
        "8509012ce35480c8036e657751fc1f08"
    ),
    "no tracks": ("a75a0980780e0009000061206d617020616c6f6e65b9b3caa7"),
    "large": (
        "a75a19a7534543011115019a1235d0968280b0b4f808de068b04197e364ea753454302101b3ab2c38560804a95882280f52306f518f800"
        "39a75345430410000102030405060708090a0b0c0d0e0feb289759a7534543030f00026a0966697273742067726f757070c38481a75345"
        "430310020101647365636f6e642067726f75708ed0592aa753454303110303007468697264a753454367726f757041ec06c1a753454305"
        "046b657074ca23e3cea753454363009b2a090fa7534543060f035219026a09191a0101641a1b0300e1eb954ea7534543070ab800000000"
        "00409546bf11d8f2ed"
    ),
    "large layered": (
        "a75a99a7534543011115019a1235d0968280b0b4f808de068b04197e364ea753454302101b3ab2c38560804a95882280f52306f518f800"
        "39a75345430410000102030405060708090a0b0c0d0e0feb289759a7534543033500026a09425a6839314159265359b06c681b00000091"
        "80400001a0de0020003100302068c9a71b09941bf177245385090b06c681b00e982b16a7534543033702010164425a6839314159265359"
        "12803435000005118040000e81da0020002201a1908069a689a06f70a2878bb9229c284809401a1a80f45fed3ca7534543033c03030042"
        "5a683931415926535953e003d400000587900a00080004e0d600008020003100d001434d31a7a9ce8bd72c24060bb9229c284829f001ea"
        "00930e0c17a753454305046b657074ca23e3cea753454363009b2a090fa7534543060f03523f026a093f4101016441460300305ec1dca7"
        "534543070a3001000000006d9b137252c88475"
    ),
    "names padded": ("a75a0980780e000909000377616c6b731f69c23e"),
    "names counted": ("a75a0980780e0009080777616c6b73305cd335"),
    "names listed": ("a75a0980780e000906016177616c6b7356dea904"),
    "names model": ("a75a0980780e00090b56a1414d7c0e00b01e012779821e985fb875f721fc3677616c6b73c7d7c362"),
    "names steps": ("a75a0980780e00091317010401268077616c6b7320cc6dce"),
}

NAMES = {
    "names padded": ("000", "001"),
    "names counted": ("7", "8"),
    "names listed": ("a",),
    "names model": ("infinite walk", "Überlingen\n"),
    "names steps": ("0001", "0002", "0005", "0011"),
}

CONTENTS = {**archives.small_archives(), **{name: one_group(archives.FLAT, ids, b"walks") for name, ids in NAMES.items()}}


@pytest.mark.parametrize("name", VERSION_1)
def test_version_1_is_read(name):
    assert from_bytes(bytes.fromhex(VERSION_1[name])) == CONTENTS[name]


# what the layer makes of a payload is bzip2's to decide, and another release of it may decide otherwise
@pytest.mark.parametrize("name", [name for name in VERSION_1 if "layered" not in name])
def test_version_1_is_written(name):
    assert to_bytes(CONTENTS[name]).hex() == VERSION_1[name]


def test_deflated_and_lzma_names_of_version_1_are_read():
    head = bytes.fromhex("a75a0980780e0009")
    deflated = archives.compact(0x09, head[3:] + bytes([2 << 2 | 3, 5 << 2 | 0]) + bytes.fromhex("4be44a0200") + b"walks")
    lzma = archives.compact(0x09, head[3:] + bytes([2 << 2 | 3, 7 << 2 | 1]) + bytes.fromhex("010002610a6200") + b"walks")
    for data in (deflated, lzma):
        assert from_bytes(data) == one_group(archives.FLAT, ("a", "b"), b"walks")

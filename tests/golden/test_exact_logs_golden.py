"""Logs kept byte by byte: every later version reads them, and columns have the same bytes."""

import numpy as np
import pytest

from gpszip.archive import open_archive
from gpszip.archive.exact import find_exact_logs
from gpszip.container.layout import Cursor
from gpszip.lossless.columns import decode_column, encode_column
from gpszip.lossless.logs import read_exact_logs


def pseudorandom(count, limit, seed):
    """Numbers of a linear congruential generator, the same in any version of NumPy."""
    numbers = []
    for _ in range(count):
        seed = (seed * 6364136223846793005 + 1442695040888963407) % 2**64
        numbers.append((seed >> 33) % limit)
    return np.array(numbers, np.int64)


TIMES = np.cumsum(1 + pseudorandom(90, 3, 1))
X = np.cumsum(40 * (1 + pseudorandom(90, 3, 1)) + pseudorandom(90, 7, 2))
Y = 3 * X + pseudorandom(90, 5, 3)
STEPS = np.cumsum(np.array([0, 0, 5, 20])[pseudorandom(90, 4, 4)])
FAR = np.concatenate([X[:45], X[45:] + 10**15])

#: Columns, whether times and the column before help, and their bytes.
COLUMNS = {
    "times": (TIMES, False),
    "near": (X, True),
    "beside": (Y, True),
    "exact": (STEPS, False),
    "outlier": (FAR, True),
}

LOGS = {
    "walk.csv": b"".join(
        b"%d.000,%.3f,%d\n" % (t, x / 1000, y)
        for t, x, y in zip(TIMES.tolist(), X.tolist(), Y.tolist(), strict=True)
    ),
    "note.txt": b"\xff\x00 no text",
    "dates.csv": b"".join(
        b"2024-02-%02dT07:08:%02d.50Z,-0.0\r\n" % (i % 29 + 1, i) for i in range(60)
    ),
    "empty": b"",
}

#: Bytes of these columns with three contexts, which are only read.
OLDER_COLUMNS = {
    "times": "02060400000128156deae76e2e6792c131d6a5325b727d5e060421fbcf",
    "near": (
        "02fc01a601000006b80a2f82e1ff652065074238407abcf6d4dd3ab8179ee082a3b0c6007982a93f49dd0714"
        "69749478ffe854c33e95bda365fb"
    ),
    "beside": (
        "02fc05f203000007981f468cd8be97ea3d8a81dd7e0a4cca0f997ba7e77d99e522eeff4dc37fa232c933e40c"
        "fa115366a0483eb5df5dca93f160dd4b294aa112364ea4667fbdbfa42582729aea8e22b30c"
    ),
    "exact": ("020a0000000108217e16a1a28fcdd484491321db7934fe311f7792d4568c47b0ab1c0e4f96acb50bd7"),
    "outlier": (
        "01fc0100230003b80a466bcde424abd94af4046dddb89501066b69d632f9e706719acba2a3798b71445d9791"
        "3ac514000006561babf772564dfcdbfb96296a8dfb7c6ad3d650895b5384374e31249502"
    ),
}

#: The same with two contexts, as they are written today.
GOLDEN_COLUMNS = {
    "times": "0706040000012816729224885ad25c1cf85fe6a857ca0ced33dff202a5c4",
    "near": (
        "07fc01a601000006b80a3283043f38e5ed8890ca368f492e52c4a75841fd8c77ed6b579ca0c365475b360217"
        "a2cd0c74045dc23ca4bd89310934f567a6"
    ),
    "beside": (
        "07fc05f203000007981f468ce4edc015307ed425b199f886c1951d9076e4a31b3b3eb66daf7c8e39bbc871f5"
        "4f081471afa41f4acc650eb5592cac83c818f00cdf66d2770cdbb824a3d8a1eb51e1805d8d"
    ),
    "exact": (
        "070a000000010825697149caed93011bb8443de47a71bfb1fcb3ad137bde23f5cb36a4f43f227869f83c1e3a6a"
    ),
    "outlier": (
        "06fc0100230003b80a496bcd4ced0b76378040f57a5fcf355e188bbc2e0065fd49eb2846c62f6254e958ac65"
        "6c3f5c4a57a40003858d9ceffcfa5721e1e2dc6c1cb32d41f7251267ccd08361ea16f86c741335"
    ),
}

GOLDEN_BODY = (
    "040877616c6b2e637376a00ddf0deb04086e6f74652e7478740adc009e020964617465732e637376880e181f"
    "523a05656d7074790000000000b21b9e0501e00db102950000198c59663901f6512df5acc5e2fd5c67f50071"
    "72e7e7bcdf4789f4535b44fbed8ba994722d17d5c8ffc3850642d9e6f10554cba74cd5064964f930b53a4142"
    "3bb67190e1ecf59dda16957b6172ab2088c8b57204d99f73816abb72c3c415e286d6e939bfe4eb849c280f30"
    "c9a2f6def3d850c2b9aa19e482a8d6ec133baa9188ca3a1de6d89d63e5322ccde13c59399fd6c7ed495f8c1d"
    "fa0770ab0ad050e9f181ad60eab6cf7567c93b4369431fef05a7476d163ce8ace362de7890bd1a2179b118a0"
    "6c0580db2004d1bcf805a0f183221ce1dec79d845fd0bf957fc4192bf0c870ca7d631b404299db7bd1e4e0c3"
    "69988da47fe0fc59bdfe42d07f368d591fa89eeffb719116db207c2af9af546271610ee1716aa90880f91394"
    "d6d3c4b712e3d4aa82353d949324e5a9c467357f7b51c04c4651a38cef12433fb78b51ecc0b1084ea7eee66b"
    "8a349252415a66a12203c66783eeabc2ec4a00f063a493bb17405162da48d4683641f5cad3ebbc23aa438891"
    "17c622db0cb129cb522443c9cfe061cb0911041c6a35c3ea8a92f050a3c80bf025bf1d61e08928bc3836d516"
    "68804e7a73d3f41d229edfd5f9c40941beb4360382f6dd20806f88dce46ebe79762141f79ac65fa0c28da938"
    "e9e67806f962fd9ca88a8230bbd27bca269bdeb4bdbab3bb5756097d5f0149b5cbf69634130f7c1886a5836f"
    "e29ede2c157d6030adb1fed0a4d902af3726eaf5ecd350a710100656349872e5151a22d102be3a1b717dad76"
    "ad28becd2a00109a32ab5afd852fa48e26ba1ad12626a5703e8a7f3f8043d66c62649fe980ab081949669538"
    "a1f85bd5766606fdd82156ff14117ad8cfcbfa0d55f2dc6c853dba1dcfe954c93414cb79a3ce7eeed93094c0"
    "e1ff5afdf8354be73a3e6b704254f70e76ce2e11599447bd540000"
)


def encoded():
    """Bytes of all columns."""
    times = encode_column(TIMES)[1]
    found, before = {}, []
    for name, (values, has_help) in COLUMNS.items():
        data, column = encode_column(values, times if has_help else None, before * has_help)
        found[name] = data
        before = [column]
    return found


@pytest.mark.parametrize("name", COLUMNS)
def test_golden_columns_are_written(name):
    assert encoded()[name].hex() == GOLDEN_COLUMNS[name]


@pytest.mark.parametrize("golden", [GOLDEN_COLUMNS, OLDER_COLUMNS], ids=["today", "older"])
def test_golden_columns_are_read(golden):
    times = encode_column(TIMES)[1]
    before = []
    for name, (values, has_help) in COLUMNS.items():
        cursor = Cursor(bytes.fromhex(golden[name]))
        known = times if has_help else None
        back, column = decode_column(cursor, len(values), known, before * has_help)
        assert np.array_equal(back, values)
        before = [column]


def test_golden_columns_are_of_both_orders():
    assert {bytes.fromhex(data)[0] for data in OLDER_COLUMNS.values()} == {1, 2}
    assert {bytes.fromhex(data)[0] for data in GOLDEN_COLUMNS.values()} == {6, 7}


def test_golden_logs_are_read():
    found = read_exact_logs(bytes.fromhex(GOLDEN_BODY))
    assert {log.name: b"".join(found.read(i)) for i, log in enumerate(found.logs)} == LOGS


def guided_text():
    """A log of two buses on one line, with a stop, a gap, and minus zeros."""
    rows = ["id,time,lat,lon,note\r\n"]
    for bus in range(2):
        elapsed = 10 + pseudorandom(60, 3, 5 + bus)
        elapsed[40] += 3600
        times = 10_000 * bus + np.cumsum(elapsed)
        way = np.cumsum((pseudorandom(60, 40, 7) + 100) * (np.arange(60) % 30 < 25))
        jitter = pseudorandom(120, 50, 9 + bus)
        for i in range(60):
            hours, rest = divmod(int(times[i]), 3600)
            time = f"2024-02-29T{hours:02}:{rest // 60:02}:{rest % 60:02}Z"
            lat = 47_000_000 + int(6 * way[i] + jitter[i])
            lon = 8_000_000 + int(3 * way[i] + jitter[60 + i])
            note = "-0.0" if i % 20 == 7 else "0.0"
            rows.append(
                f"bus{bus + 7},{time},{lat // 10**6}.{lat % 10**6:06},"
                f"{lon // 10**6}.{lon % 10**6:06},{note}\r\n"
            )
    return "".join(rows).encode()


#: An archive of this log, at an RMSE of 20 m.
GOLDEN_GUIDED = (
    "a75a3b011115015e122103a09096a4fedd0cad0ba32102070b16aedb4e51d20802c81c031e0002003b1a82ec"
    "7bce04faf5fa5d66951b0343fa54f580b09adcbe6a007b0df9030101076275732e6373768c2fe798dd16012c"
    "0105011669642c74696d652c6c61742c6c6f6e2c6e6f74650d0a0201020000000318013af62e017803000000"
    "f62eb703037801151213492a2dfecfa0f39f314a074481102f170000000000000000060006200106010e0000"
    "000308050007b6bf61020201020000000318013a0078000046ff00000106020600010100000296a4fedd0c16"
    "000001b8012e3b19c0ca6411af31d2e4da95f7a50da166e1328715aef5f99d21517f9fe2fcd90c67f559ba0f"
    "048fc0f31cfeb39f010100000492b4e92c800b000007a85889014ce0760355124122e9ed1f2d50d8982d1505"
    "4875e254cc1563d23a5df7514c35eeed6859327d71f5cb29007aed87201728432ef60e2cb3216efc8b3e4558"
    "59a45fcf5b907cf6adbe844cde7950cc21c80b095e4dd53cba17c35e97685c835acf6ce466f3c880a36a6e0f"
    "c0d3b049a4780ee58a08ff965d051fb99fdc492e3ee038fe568912e5f7ea3e010101000002f6ced007c00500"
    "0006a82c7b350e6f7e84a4eaaf41fd3d0e0105f100e5edc1c5e0f2357e52f0ee3eb52d0de3cbb78e4a860189"
    "589472946faeb3c524c8363e988249779ff6908dddda319bc41de9160dcf47b61a021fdac1ec7bd3c2338d06"
    "88457cc796b0a02c16c09c4d7c5d9a8b8f8250873e176b3d3e7a50b2a0cc13fafcb7377053b112c200010100"
    "00000066d773bb"
)


#: The same archive with columns of two contexts, as it is written today.
GOLDEN_TWO_CONTEXTS = (
    "a75a3b011115015e122103a09096a4fedd0cad0ba32102070b16aedb4e51d20802c81c031e0002003b1a82ec"
    "7bce04faf5fa5d66951b0343fa54f580b09adcbe6a007b0df6030101076275732e6373768c2fe798dd16012c"
    "0105011669642c74696d652c6c61742c6c6f6e2c6e6f74650d0a02070202000001180139f62e017803000000"
    "f62eb403037801151213492a2dfecfa0f39f314a074481102f170000000000000000060006200106070e0000"
    "00010804002886d302020702020000011801390078000046ff00000106020600010100000796a4fedd0c1600"
    "0001b801313a0749b395bf479956afccb08078d451cd8b90de8ae4e06bfed05fad1658923909d70bd37a3be1"
    "20dbfa41c38fa49c78d7010100000892b4e92c00000003a8588601481ab42d6eb00b7974321640cbdfa425e9"
    "be4aea8aaaf032d93ca275980bd5844b9dda518223082bbe2892e8b2cf0b057b95f9a5e403bbb1ac33a6c460"
    "e4193bafbfe87a2704a74289aadbb8a0a6db1c78acfbcd7f6243c22011b6278821bf41ca943c3b123fa39aa6"
    "6d25accabe46300e6f764856d2db7dfd016e92d7c02f3a8d91cdc7bad5010101000007f6ced007c005000006"
    "a82c7a350e6d520bc862a12c99505362ec2637043525d99293c742d061a1588d3774ff1173dd388ab3e21df9"
    "7b2587b5b0e1215e25fbf1de2f5a2f594db0e43a2b7e005e8238aa4f4b2b4a1bdf628ebc0d070ab2c49cb2dc"
    "06211d930004dda49bb2786a59454d160de78df7436d04e3ac69d0a3c8b2e933f224f106bc00010100000000"
    "b46d3941"
)


@pytest.mark.parametrize("golden", [GOLDEN_GUIDED, GOLDEN_TWO_CONTEXTS], ids=["older", "today"])
def test_a_golden_log_that_walks_predict_is_read(golden):
    archive = open_archive(bytes.fromhex(golden))
    logs = find_exact_logs(archive)
    assert logs.is_guided
    assert b"".join(logs.read(0)) == guided_text()

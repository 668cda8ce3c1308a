"""The check algorithms that a protocol file may name, as facts. Nothing here computes a check.

CRC parameters and check values: Greg Cook's "Catalogue of parametrised CRC algorithms" (reveng), those of up
to 64 bits. The check value is the algorithm's result over the nine ASCII bytes ``123456789``.
"""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind
from wirebond.protocol.problems import suggestion

_CRCS = """\
name                     bits poly             init             refin refout xorout           check
crc-3/gsm                3    3                0                no    no     7                4
crc-3/rohc               3    3                7                yes   yes    0                6
crc-4/g-704              4    3                0                yes   yes    0                7
crc-4/interlaken         4    3                F                no    no     F                B
crc-5/epc-c1g2           5    09               09               no    no     00               00
crc-5/g-704              5    15               00               yes   yes    00               07
crc-5/usb                5    05               1F               yes   yes    1F               19
crc-6/cdma2000-a         6    27               3F               no    no     00               0D
crc-6/cdma2000-b         6    07               3F               no    no     00               3B
crc-6/darc               6    19               00               yes   yes    00               26
crc-6/g-704              6    03               00               yes   yes    00               06
crc-6/gsm                6    2F               00               no    no     3F               13
crc-7/mmc                7    09               00               no    no     00               75
crc-7/rohc               7    4F               7F               yes   yes    00               53
crc-7/umts               7    45               00               no    no     00               61
crc-8/autosar            8    2F               FF               no    no     FF               DF
crc-8/bluetooth          8    A7               00               yes   yes    00               26
crc-8/cdma2000           8    9B               FF               no    no     00               DA
crc-8/darc               8    39               00               yes   yes    00               15
crc-8/dvb-s2             8    D5               00               no    no     00               BC
crc-8/gsm-a              8    1D               00               no    no     00               37
crc-8/gsm-b              8    49               00               no    no     FF               94
crc-8/hitag              8    1D               FF               no    no     00               B4
crc-8/i-432-1            8    07               00               no    no     55               A1
crc-8/i-code             8    1D               FD               no    no     00               7E
crc-8/lte                8    9B               00               no    no     00               EA
crc-8/maxim-dow          8    31               00               yes   yes    00               A1
crc-8/mifare-mad         8    1D               C7               no    no     00               99
crc-8/nrsc-5             8    31               FF               no    no     00               F7
crc-8/opensafety         8    2F               00               no    no     00               3E
crc-8/rohc               8    07               FF               yes   yes    00               D0
crc-8/sae-j1850          8    1D               FF               no    no     FF               4B
crc-8/smbus              8    07               00               no    no     00               F4
crc-8/tech-3250          8    1D               FF               yes   yes    00               97
crc-8/wcdma              8    9B               00               yes   yes    00               25
crc-10/atm               10   233              000              no    no     000              199
crc-10/cdma2000          10   3D9              3FF              no    no     000              233
crc-10/gsm               10   175              000              no    no     3FF              12A
crc-11/flexray           11   385              01A              no    no     000              5A3
crc-11/umts              11   307              000              no    no     000              061
crc-12/cdma2000          12   F13              FFF              no    no     000              D4D
crc-12/dect              12   80F              000              no    no     000              F5B
crc-12/gsm               12   D31              000              no    no     FFF              B34
crc-12/umts              12   80F              000              no    yes    000              DAF
crc-13/bbc               13   1CF5             0000             no    no     0000             04FA
crc-14/darc              14   0805             0000             yes   yes    0000             082D
crc-14/gsm               14   202D             0000             no    no     3FFF             30AE
crc-15/can               15   4599             0000             no    no     0000             059E
crc-15/mpt1327           15   6815             0000             no    no     0001             2566
crc-16/arc               16   8005             0000             yes   yes    0000             BB3D
crc-16/cdma2000          16   C867             FFFF             no    no     0000             4C06
crc-16/cms               16   8005             FFFF             no    no     0000             AEE7
crc-16/dds-110           16   8005             800D             no    no     0000             9ECF
crc-16/dect-r            16   0589             0000             no    no     0001             007E
crc-16/dect-x            16   0589             0000             no    no     0000             007F
crc-16/dnp               16   3D65             0000             yes   yes    FFFF             EA82
crc-16/en-13757          16   3D65             0000             no    no     FFFF             C2B7
crc-16/genibus           16   1021             FFFF             no    no     FFFF             D64E
crc-16/gsm               16   1021             0000             no    no     FFFF             CE3C
crc-16/ibm-3740          16   1021             FFFF             no    no     0000             29B1
crc-16/ibm-sdlc          16   1021             FFFF             yes   yes    FFFF             906E
crc-16/iso-iec-14443-3-a 16   1021             C6C6             yes   yes    0000             BF05
crc-16/kermit            16   1021             0000             yes   yes    0000             2189
crc-16/lj1200            16   6F63             0000             no    no     0000             BDF4
crc-16/m17               16   5935             FFFF             no    no     0000             772B
crc-16/maxim-dow         16   8005             0000             yes   yes    FFFF             44C2
crc-16/mcrf4xx           16   1021             FFFF             yes   yes    0000             6F91
crc-16/modbus            16   8005             FFFF             yes   yes    0000             4B37
crc-16/nrsc-5            16   080B             FFFF             yes   yes    0000             A066
crc-16/opensafety-a      16   5935             0000             no    no     0000             5D38
crc-16/opensafety-b      16   755B             0000             no    no     0000             20FE
crc-16/profibus          16   1DCF             FFFF             no    no     FFFF             A819
crc-16/riello            16   1021             B2AA             yes   yes    0000             63D0
crc-16/spi-fujitsu       16   1021             1D0F             no    no     0000             E5CC
crc-16/t10-dif           16   8BB7             0000             no    no     0000             D0DB
crc-16/teledisk          16   A097             0000             no    no     0000             0FB3
crc-16/tms37157          16   1021             89EC             yes   yes    0000             26B1
crc-16/umts              16   8005             0000             no    no     0000             FEE8
crc-16/usb               16   8005             FFFF             yes   yes    FFFF             B4C8
crc-16/xmodem            16   1021             0000             no    no     0000             31C3
crc-17/can-fd            17   1685B            00000            no    no     00000            04F03
crc-21/can-fd            21   102899           000000           no    no     000000           0ED841
crc-24/ble               24   00065B           555555           yes   yes    000000           C25A56
crc-24/flexray-a         24   5D6DCB           FEDCBA           no    no     000000           7979BD
crc-24/flexray-b         24   5D6DCB           ABCDEF           no    no     000000           1F23B8
crc-24/interlaken        24   328B63           FFFFFF           no    no     FFFFFF           B4F3E6
crc-24/lte-a             24   864CFB           000000           no    no     000000           CDE703
crc-24/lte-b             24   800063           000000           no    no     000000           23EF52
crc-24/openpgp           24   864CFB           B704CE           no    no     000000           21CF02
crc-24/os-9              24   800063           FFFFFF           no    no     FFFFFF           200FA5
crc-30/cdma              30   2030B9C7         3FFFFFFF         no    no     3FFFFFFF         04C34ABF
crc-31/philips           31   04C11DB7         7FFFFFFF         no    no     7FFFFFFF         0CE9E46C
crc-32/aixm              32   814141AB         00000000         no    no     00000000         3010BF7F
crc-32/autosar           32   F4ACFB13         FFFFFFFF         yes   yes    FFFFFFFF         1697D06A
crc-32/base91-d          32   A833982B         FFFFFFFF         yes   yes    FFFFFFFF         87315576
crc-32/bzip2             32   04C11DB7         FFFFFFFF         no    no     FFFFFFFF         FC891918
crc-32/cd-rom-edc        32   8001801B         00000000         yes   yes    00000000         6EC2EDC4
crc-32/cksum             32   04C11DB7         00000000         no    no     FFFFFFFF         765E7680
crc-32/iscsi             32   1EDC6F41         FFFFFFFF         yes   yes    FFFFFFFF         E3069283
crc-32/iso-hdlc          32   04C11DB7         FFFFFFFF         yes   yes    FFFFFFFF         CBF43926
crc-32/jamcrc            32   04C11DB7         FFFFFFFF         yes   yes    00000000         340BC6D9
crc-32/mef               32   741B8CD7         FFFFFFFF         yes   yes    00000000         D2C22F51
crc-32/mpeg-2            32   04C11DB7         FFFFFFFF         no    no     00000000         0376E6E7
crc-32/xfer              32   000000AF         00000000         no    no     00000000         BD0BE338
crc-40/gsm               40   0004820009       0000000000       no    no     FFFFFFFFFF       D4164FC646
crc-64/ecma-182          64   42F0E1EBA9EA3693 0000000000000000 no    no     0000000000000000 6C40DF5F0B497347
crc-64/go-iso            64   000000000000001B FFFFFFFFFFFFFFFF yes   yes    FFFFFFFFFFFFFFFF B90956C775A41001
crc-64/ms                64   259C84CBA6426349 FFFFFFFFFFFFFFFF yes   yes    0000000000000000 75D4B74F024ECEEA
crc-64/nvme              64   AD93D23594C93659 FFFFFFFFFFFFFFFF yes   yes    FFFFFFFFFFFFFFFF AE8B14860A799888
crc-64/redis             64   AD93D23594C935A9 0000000000000000 yes   yes    0000000000000000 E9C6D914C4B8D9CA
crc-64/we                64   42F0E1EBA9EA3693 FFFFFFFFFFFFFFFF no    no     FFFFFFFFFFFFFFFF 62EC59E3F1A4F00A
crc-64/xz                64   42F0E1EBA9EA3693 FFFFFFFFFFFFFFFF yes   yes    FFFFFFFFFFFFFFFF 995DC9BBDF1939FA
"""  # numbers in hexadecimal, as the catalogue writes them
# Sums are modulo 2^bits; their order of bytes on the wire is the frame's business.
# inverted: one's complement; negated: two's complement. fletcher-16/mod256 is the "8-bit Fletcher" of RFC 1145,
# internet the checksum of RFC 1071, adler-32 that of RFC 1950. Words of 2 or 4 bytes have the byte order of the check
# unless the file says otherwise, and zero bytes complete the last one. The results are those of high bytes first.
_OTHERS = """\
name               kind     bits init   xorout modulus negated unit carry check
xor8               xor      8    0      00     0       no      1    drop  31
xor16              xor      16   0      0000   0       no      2    drop  3908
xor32              xor      32   0      0      0       no      4    drop  3D04040C
sum8               sum      8    0      00     0       no      1    drop  DD
sum8-inverted      sum      8    0      FF     0       no      1    drop  22
sum8-negated       sum      8    0      00     0       yes     1    drop  23
sum16              sum      16   0      0000   0       no      1    drop  01DD
sum16-inverted     sum      16   0      FFFF   0       no      1    drop  FE22
sum16-negated      sum      16   0      0000   0       yes     1    drop  FE23
sum32              sum      32   0      0      0       no      1    drop  000001DD
internet           sum      16   0      FFFF   0       no      2    end   F62A
fletcher-16        fletcher 16   0      0000   255     no      1    drop  1EDE
fletcher-16/mod256 fletcher 16   0      0000   256     no      1    drop  15DD
fletcher-32        fletcher 32   0      0      65535   no      2    drop  09DF09D5
adler-32           fletcher 32   1      0      65521   no      1    drop  091E01DE
"""
# CRC-32/MPEG-2 over words of 32 bits, low byte first: the CRC unit of an STM32, as its HAL configures it.
_OF_WORDS = {"crc-32/stm32": ("crc-32/mpeg-2", 4, ByteOrder.LITTLE, 0xAFF19057)}


def _tables() -> tuple[dict[str, Algorithm], dict[str, int]]:
    found: dict[str, Algorithm] = {}
    check_values: dict[str, int] = {}
    for line in _OTHERS.splitlines()[1:]:
        name, kind, bits, init, xorout, modulus, negated, unit, carry, check = line.split()
        found[name] = Algorithm(
            name,
            CheckKind(kind),
            int(bits),
            init=int(init, 16),
            xorout=int(xorout, 16),
            modulus=int(modulus),
            negate=negated == "yes",
            unit=int(unit),
            end_around=carry == "end",
        )
        check_values[name] = int(check, 16)
    for line in _CRCS.splitlines()[1:]:
        name, bits, poly, init, refin, refout, xorout, check = line.split()
        reflected = (refin == "yes", refout == "yes")
        found[name] = Algorithm(
            name, CheckKind.CRC, int(bits), int(poly, 16), int(init, 16), *reflected, int(xorout, 16)
        )
        check_values[name] = int(check, 16)
    for name, (base, size, order, value) in _OF_WORDS.items():
        found[name] = replace(found[base], name=name, unit=size, unit_order=order)
        check_values[name] = value
    return found, check_values


#: By catalogue name, and the published result of each over ``123456789``.
ALGORITHMS, CHECK_VALUES = _tables()

ALIASES: dict[str, str] = {
    "adler32": "adler-32",
    "arc": "crc-16/arc",
    "b-crc-32": "crc-32/bzip2",
    "cksum": "crc-32/cksum",
    "crc-10": "crc-10/atm",
    "crc-10/i-610": "crc-10/atm",
    "crc-11": "crc-11/flexray",
    "crc-12-x": "crc-12/dect",
    "crc-12/3gpp": "crc-12/umts",
    "crc-15": "crc-15/can",
    "crc-16/acorn": "crc-16/xmodem",
    "crc-16/aug-ccitt": "crc-16/spi-fujitsu",
    "crc-16/autosar": "crc-16/ibm-3740",
    "crc-16/buypass": "crc-16/umts",
    "crc-16/ccitt-false": "crc-16/ibm-3740",
    "crc-16/ccitt-true": "crc-16/kermit",
    "crc-16/epc": "crc-16/genibus",
    "crc-16/epc-c1g2": "crc-16/genibus",
    "crc-16/i-code": "crc-16/genibus",
    "crc-16/iec-61158-2": "crc-16/profibus",
    "crc-16/iso-hdlc": "crc-16/ibm-sdlc",
    "crc-16/iso-iec-14443-3-b": "crc-16/ibm-sdlc",
    "crc-16/lte": "crc-16/xmodem",
    "crc-16/maxim": "crc-16/maxim-dow",
    "crc-16/v-41-lsb": "crc-16/kermit",
    "crc-16/v-41-msb": "crc-16/xmodem",
    "crc-16/verifone": "crc-16/umts",
    "crc-16/x-25": "crc-16/ibm-sdlc",
    "crc-24": "crc-24/openpgp",
    "crc-32": "crc-32/iso-hdlc",
    "crc-32/aal5": "crc-32/bzip2",
    "crc-32/adccp": "crc-32/iso-hdlc",
    "crc-32/base91-c": "crc-32/iscsi",
    "crc-32/castagnoli": "crc-32/iscsi",
    "crc-32/dect-b": "crc-32/bzip2",
    "crc-32/interlaken": "crc-32/iscsi",
    "crc-32/posix": "crc-32/cksum",
    "crc-32/v-42": "crc-32/iso-hdlc",
    "crc-32/xz": "crc-32/iso-hdlc",
    "crc-32c": "crc-32/iscsi",
    "crc-32d": "crc-32/base91-d",
    "crc-32q": "crc-32/aixm",
    "crc-4/itu": "crc-4/g-704",
    "crc-5/epc": "crc-5/epc-c1g2",
    "crc-5/itu": "crc-5/g-704",
    "crc-6/itu": "crc-6/g-704",
    "crc-64": "crc-64/ecma-182",
    "crc-64/go-ecma": "crc-64/xz",
    "crc-7": "crc-7/mmc",
    "crc-8": "crc-8/smbus",
    "crc-8/aes": "crc-8/tech-3250",
    "crc-8/ebu": "crc-8/tech-3250",
    "crc-8/itu": "crc-8/i-432-1",
    "crc-8/maxim": "crc-8/maxim-dow",
    "crc-a": "crc-16/iso-iec-14443-3-a",
    "crc-b": "crc-16/ibm-sdlc",
    "crc-ibm": "crc-16/arc",
    "dow-crc": "crc-8/maxim-dow",
    "fletcher32": "fletcher-32",
    "hoverboard": "xor16",
    "inet": "internet",
    "jamcrc": "crc-32/jamcrc",
    "kermit": "crc-16/kermit",
    "lrc": "sum8-negated",
    "modbus": "crc-16/modbus",
    "pkzip": "crc-32/iso-hdlc",
    "r-crc-16": "crc-16/dect-r",
    "stm32-crc": "crc-32/stm32",
    "x-25": "crc-16/ibm-sdlc",
    "x-crc-16": "crc-16/dect-x",
    "xfer": "crc-32/xfer",
    "xmodem": "crc-16/xmodem",
    "zmodem": "crc-16/xmodem",
}

# Names under which different things are sold: guessing would give a link that never passes a check.
AMBIGUOUS: dict[str, tuple[str, ...]] = {
    "crc16": ("crc-16/arc", "crc-16/modbus", "crc-16/ibm-3740", "crc-16/xmodem"),
    "crc-16": ("crc-16/arc", "crc-16/modbus", "crc-16/ibm-3740", "crc-16/xmodem"),
    "crc-ccitt": ("crc-16/kermit", "crc-16/ibm-3740", "crc-16/xmodem", "crc-16/ibm-sdlc"),
    "crc-16/ccitt": ("crc-16/kermit", "crc-16/ibm-3740", "crc-16/xmodem", "crc-16/ibm-sdlc"),
    "fletcher": ("fletcher-16", "fletcher-16/mod256", "fletcher-32"),
    "sum": ("sum8", "sum16", "sum32"),
    "xor": ("xor8", "xor16", "xor32"),
}


# Kinds that a file may name with a width of its own.
OWN_KINDS = {kind.value: kind for kind in CheckKind}


def find(name: str) -> Algorithm | None:
    """Return the algorithm of this name or alias, under its catalogue name; None if there is none."""
    return ALGORITHMS.get(ALIASES.get(name, name))


def in_order(algorithm: Algorithm, order: ByteOrder) -> Algorithm:
    """Set the byte order of words to that of the check's own bytes. A CRC over words has an order by its name."""
    if algorithm.unit == 1 or algorithm.kind == CheckKind.CRC:
        return algorithm
    return replace(algorithm, unit_order=order)


def advice_for_kind(kind: CheckKind) -> str:
    """Return the advice for a kind without its width."""
    if kind == CheckKind.CRC:
        return "name one of the catalogue"
    return f"name one: {', '.join(AMBIGUOUS[kind.value])}"


def advice_for_unknown(name: str) -> str:
    """Return the advice for a name that `find` does not know."""
    meanings = AMBIGUOUS.get(name.lower())
    if meanings is not None:
        return f"say which: {', '.join(meanings)}"
    return suggestion(name, [*ALGORITHMS, *ALIASES])

"""Well-known kinds of files that are not read, and what to do with them."""

from typing import NamedTuple

from fdbench.reading.servo_tuning import ROOT

_SCOPE = (
    "Export it in TwinCAT Scope as CSV or svb, or by its tool: TC3ScopeExportTool.exe svd=FILE target=FILE.csv silent."
)
_UNPACK = "Unpack it first."


FIRST_LINES = 4096  # bytes


class _Kind(NamedTuple):
    """A kind of file: how it begins, what its first lines hold, or what its name ends with."""

    words: str
    advice: str
    magic: tuple[bytes, ...] = ()
    suffixes: tuple[str, ...] = ()
    element: bytes = b""

    def begins(self, head: bytes) -> bool:
        """Return whether a file that begins so is of this kind."""
        return head.startswith(self.magic) or bool(self.element and self.element in head[:FIRST_LINES])


_KINDS = (
    _Kind("a recording of TwinCAT Scope", _SCOPE, suffixes=(".svdx", ".svd", ".svbx")),
    _Kind("a project of TwinCAT Scope", _SCOPE, suffixes=(".tcscopex", ".tcscope", ".tcmproj")),
    _Kind(
        "a result of SINUMERIK's Automatic Servo Tuning, which holds no record",
        "`fdbench import` makes a model of it.",
        element=ROOT,
    ),
    _Kind(
        "a measurement of SINUMERIK's measuring function",
        "Save a trace of the same motion (Diagnostics, Trace), or the result of an Automatic Servo Tuning.",
        element=b"<ResponseTest",
    ),
    _Kind(
        "TDMS of National Instruments",
        "Write it as CSV, such as in Python by the package npTDMS: "
        "nptdms.TdmsFile.read(FILE)[GROUP].as_dataframe(time_index=True).to_csv('run.csv').",
        (b"TDSm", b"TDSh"),
        (".tdms",),
    ),
    _Kind(
        "HDF5",
        "Write its columns as CSV or Parquet, such as in Python by pandas.DataFrame(...).to_parquet('run.parquet'); "
        "in MATLAB: save(file, '-v7').",
        (b"\x89HDF\r\n\x1a\n",),
        (".h5", ".hdf5"),
    ),
    _Kind("an Excel workbook", "Save its sheet as CSV.", (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",), (".xls", ".ods")),
    _Kind("an Excel workbook", "Save its sheet as CSV in UTF-8.", suffixes=(".xlsx", ".xlsm", ".xlsb")),
    _Kind("a ZIP archive or an Excel workbook", "Unpack it, or save its sheet as CSV.", (b"PK\x03\x04",), (".zip",)),
    _Kind("compressed by gzip", _UNPACK, (b"\x1f\x8b",)),
    _Kind("compressed by bzip2", _UNPACK, (b"BZh",)),
    _Kind("compressed by xz", _UNPACK, (b"\xfd7zXZ\x00",)),
    _Kind("compressed by Zstandard", _UNPACK, (b"\x28\xb5\x2f\xfd",)),
    _Kind("a 7z archive", _UNPACK, (b"7z\xbc\xaf\x27\x1c",)),
    _Kind(
        "Arrow or Feather",
        "In Python: pandas.read_feather(FILE).to_parquet('run.parquet').",
        (b"ARROW1\x00\x00", b"FEA1"),
        (".feather", ".arrow"),
    ),
    _Kind("an array of NumPy", "In Python: write its columns as CSV, with their names.", (b"\x93NUMPY",), (".npy",)),
    _Kind("a CAN log of Vector (BLF)", "Export its signals as MDF or CSV.", (b"LOGG",), (".blf",)),
    _Kind("a database of Microsoft Access", "Export its table as CSV.", (b"\x00\x01\x00\x00Standard",), (".mdb",)),
)


def told_by_head(head: bytes) -> str:
    r"""Return what a file that begins so is and what to do with it, or an empty text.

    >>> told_by_head(b"\x1f\x8b\x08")
    'compressed by gzip. Unpack it first.'
    """
    return next((_said(kind) for kind in _KINDS if kind.begins(head)), "")


def told_by_suffix(suffix: str) -> str:
    """Return what a file is whose name ends so, or an empty text."""
    return next((_said(kind) for kind in _KINDS if suffix in kind.suffixes), "")


def _said(kind: _Kind) -> str:
    return f"{kind.words}. {kind.advice}"

"""Logs of every format."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat


def write(path, channels, *, units=(), properties=()):
    """Channels {name: values} in the format of the name's ending; a name may be GROUP/CHANNEL or STRUCT.FIELD."""
    if path.suffix == ".csv":
        np.savetxt(path, np.column_stack(list(channels.values())), "%.17g", ",", header=",".join(channels), comments="")
    elif path.suffix == ".tdms":
        nptdms = pytest.importorskip("nptdms")
        with nptdms.TdmsWriter(path) as out:
            for name, values in channels.items():
                group, _, channel = name.rpartition("/")
                told = {"unit_string": dict(units)[name]} if name in dict(units) else {}
                out.write_segment([nptdms.ChannelObject(group or "Log", channel, values, {**told, **dict(properties)})])
    elif path.name.endswith("-v73.mat"):
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as out:
            for name, values in channels.items():  # MATLAB's columns are HDF5's rows
                out[name.replace(".", "/")] = np.atleast_2d(values) if values.ndim == 1 else values.T
        with path.open("r+b") as out:
            out.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
    else:
        tree: dict = {}
        for name, values in channels.items():
            *above, last = name.split(".")
            place = tree
            for key in above:
                place = place.setdefault(key, {})
            place[last] = values
        savemat(path, tree, do_compression=True, oned_as="column")
    return path

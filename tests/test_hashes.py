"""What is remembered of the files of a recording: each hashed once, again where its stamp differs, in one file."""

import hashlib
import json
import os

import pytest

from jumpvision.base import storage
from jumpvision.base.schema import InputError
from jumpvision.experiment.workflow import hashes
from jumpvision.experiment.workflow.hashes import Hashes

NAMES = ["a.png", "b with space.png", "z.png", "ü.png"]


@pytest.fixture
def film(tmp_path, monkeypatch):
    """(folder of pictures, cache, the files that are hashed)."""
    folder = tmp_path / "film"
    folder.mkdir()
    for name in NAMES:
        (folder / name).write_text(name)
    monkeypatch.setattr(hashes, "settled", lambda *_: True)  # they are new, which no test waits for
    read = []
    monkeypatch.setattr(hashes, "sha256", lambda f: read.append(f.name) or storage.sha256(f))
    return folder, tmp_path / "cache", read


def by_hand(folder):
    """SHA-256 of the JSON of all digests by name: what keys of the cache have held since the first version."""
    digests = {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in folder.iterdir()}
    return hashlib.sha256(json.dumps(digests, sort_keys=True).encode()).hexdigest()


def test_pictures_of_a_folder_are_hashed_once_and_remembered_in_one_file(film):
    folder, cache, read = film
    assert Hashes(cache).of_recording(folder) == by_hand(folder) and sorted(read) == NAMES
    assert len(list((cache / storage.HASHES).iterdir())) == 1
    again = Hashes(cache)
    assert again.of_recording(folder) == by_hand(folder) and sorted(read) == NAMES
    digests = {os.path.basename(f): digest for f, digest, _ in again.read[folder]}
    assert digests == {n: hashlib.sha256(n.encode()).hexdigest() for n in NAMES}
    assert [at for _, _, at in again.read[folder]] == [storage.stamp(folder / n) for n in NAMES]


def test_only_what_has_changed_is_hashed_again(film):
    folder, cache, read = film
    known = Hashes(cache)
    known.of_recording(folder)
    (folder / NAMES[1]).write_text("another picture")
    (folder / "c.png").write_text("new")
    (folder / NAMES[3]).unlink()
    for which in (known, Hashes(cache)):  # in the same run, and in a later one
        del read[:]
        assert which.of_recording(folder) == by_hand(folder)
        assert sorted(read) == ([NAMES[1], "c.png"] if which is known else [])


def test_verify_trusts_no_stamp_of_an_earlier_run(film):
    folder, cache, read = film
    Hashes(cache).of_recording(folder)
    del read[:]
    Hashes(cache, verify=True).of_recording(folder)
    assert sorted(read) == NAMES


@pytest.mark.parametrize("how", ["of a bit", "cut", "as of an earlier version"])
def test_a_damaged_memory_is_none(film, how):
    folder, cache, read = film
    Hashes(cache).of_recording(folder)
    file = storage.memory(cache, storage.HASHES, folder)
    text = file.read_text(encoding="utf-8")
    if how == "as of an earlier version":
        storage.remember(cache, storage.HASHES, folder, {"stamp": [1, 2, 3, 4], "sha256": "00" * 32})
    else:
        file.write_text(
            text.replace('"known": "', '"known": "A') if how == "of a bit" else text[:-50], encoding="utf-8"
        )
    del read[:]
    assert Hashes(cache).of_recording(folder) == by_hand(folder) and sorted(read) == NAMES


def test_who_stops_while_100_gb_are_hashed_does_not_lose_them(film, monkeypatch):
    """Remembered every minute (here: after each file), so that a later run goes on where this one stopped."""
    folder, cache, read = film
    monkeypatch.setattr(hashes, "EACH", 0.0)
    hashed = hashes.sha256

    def stops(f):
        if f.name == NAMES[2]:
            raise KeyboardInterrupt
        return hashed(f)

    monkeypatch.setattr(hashes, "sha256", stops)
    with pytest.raises(KeyboardInterrupt):
        Hashes(cache).of_recording(folder)
    monkeypatch.setattr(hashes, "sha256", hashed)
    del read[:]
    assert Hashes(cache).of_recording(folder) == by_hand(folder)
    assert sorted(read) == NAMES[2:]


def test_files_of_a_pattern_and_headers_belong_to_a_recording(film):
    folder, cache, _ = film
    known = Hashes(cache)
    known.of_recording(folder / "[ab]*.png")
    assert [os.path.basename(f) for f, _, _ in known.read[folder / "[ab]*.png"]] == NAMES[:2]
    (folder / "shot.mraw").write_text("film")
    (folder / "shot.cihx").write_text("header")
    known.of_recording(folder / "shot.mraw")
    assert [os.path.basename(f) for f, _, _ in known.read[folder / "shot.mraw"]] == ["shot.cihx", "shot.mraw"]


def test_a_file_that_changes_all_the_time_is_refused(film, monkeypatch):
    folder, cache, _ = film

    def written(f):
        f.write_text(f.read_text() + "more")
        return "00" * 32

    monkeypatch.setattr(hashes, "sha256", written)
    with pytest.raises(InputError, match=r"a\.png: changes while it is read; run again"):
        Hashes(cache).of_recording(folder)

"""SHA-256 of recordings by their stamps: each file is hashed once, again where its stamp differs, in one table."""

import hashlib
import json
import os
import sqlite3
import threading

import pytest

from jumpvision.base import storage
from jumpvision.base.schema import InputError
from jumpvision.experiment.workflow import stamps
from jumpvision.experiment.workflow.stamps import Stamps, text_of

NAMES = ["a.png", "b with space.png", "z.png", "ü.png"]


@pytest.fixture
def film(tmp_path, monkeypatch):
    """(folder of pictures, cache, the files that are hashed)."""
    folder = tmp_path / "film"
    folder.mkdir()
    for name in NAMES:
        (folder / name).write_text(name)
    monkeypatch.setattr(stamps, "settled", lambda *_: True)  # they are new, which no test waits for
    read = []
    monkeypatch.setattr(stamps, "sha256", lambda f: read.append(f.name) or storage.sha256(f))
    return folder, tmp_path / "cache", read


def by_hand(folder):
    """SHA-256 of the JSON of all digests by name: what keys of the cache have held since the first version."""
    digests = {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in folder.iterdir()}
    return hashlib.sha256(json.dumps(digests, sort_keys=True).encode()).hexdigest()


def test_pictures_of_a_folder_are_hashed_once_in_one_table(film):
    folder, cache, read = film
    assert Stamps(cache).of_recording(folder) == by_hand(folder) and sorted(read) == NAMES
    assert {f.name for f in cache.iterdir()} == {stamps.TABLE, "CACHEDIR.TAG"}
    again = Stamps(cache)
    assert again.of_recording(folder) == by_hand(folder) and sorted(read) == NAMES
    found = {os.path.basename(f): (digest, at) for f, digest, at in again.recordings[folder]}
    assert found == {n: (hashlib.sha256(n.encode()).hexdigest(), text_of(storage.stamp(folder / n))) for n in NAMES}


def test_only_what_has_changed_is_hashed_again(film):
    folder, cache, read = film
    known = Stamps(cache)
    known.of_recording(folder)
    (folder / NAMES[1]).write_text("another picture")
    (folder / "c.png").write_text("new")
    (folder / NAMES[3]).unlink()
    later, verified = Stamps(cache), Stamps(cache, verify=True)  # which trusts no stamp of an earlier run
    for which, hashed in ((known, [NAMES[1], "c.png"]), (later, []), (verified, [*NAMES[:2], "c.png", NAMES[2]])):
        del read[:]
        assert which.of_recording(folder) == by_hand(folder) and sorted(read) == sorted(hashed)


def test_what_was_hashed_just_after_its_change_is_known_in_this_run_alone(film, monkeypatch):
    """A disk dates changes coarsely: it may change again without another date."""
    folder, cache, read = film
    monkeypatch.setattr(stamps, "settled", storage.settled)
    known = Stamps(cache)
    for which, hashed in ((known, NAMES), (known, []), (Stamps(cache), NAMES)):
        del read[:]
        which.of_recording(folder)
        assert sorted(read) == hashed


FIRST = "(SELECT {} FROM files ORDER BY path LIMIT 1)"
DAMAGE = {
    "a digest": "UPDATE files SET known = substr(known, 1, length(known) - 1) || 'x'",
    "rows exchanged": f"UPDATE files SET known = {FIRST.format('known')}, seal = {FIRST.format('seal')}",
    "of another kind": "UPDATE files SET known = 1",
    "cut": lambda content: content[:5000],
    "no table": lambda content: b"no table at all" * 99,
    "empty": lambda content: b"",
}


def test_what_is_damaged_is_hashed_again_and_known_from_then_on(film):
    folder, cache, read = film
    file = cache / stamps.TABLE
    Stamps(cache).of_recording(folder)
    for how, damage in DAMAGE.items():
        if isinstance(damage, str):
            connection = sqlite3.connect(file)
            connection.executescript(damage)
            connection.close()
        else:
            file.write_bytes(damage(file.read_bytes()))
        del read[:]
        assert Stamps(cache).of_recording(folder) == by_hand(folder)
        assert sorted(read) == (NAMES[1:] if how == "rows exchanged" else NAMES), how
        Stamps(cache).of_recording(folder)  # a damaged file was removed: written anew
        del read[:]
        assert Stamps(cache).of_recording(folder) == by_hand(folder) and read == [], how


def test_several_write_at_once(film):
    folder, cache, read = film
    for k in range(50):
        (folder / f"{k}.png").write_text(str(k))
    found = []
    threads = [threading.Thread(target=lambda: found.append(Stamps(cache).of_recording(folder))) for _ in range(8)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert found == [by_hand(folder)] * 8
    del read[:]
    assert Stamps(cache).of_recording(folder) == by_hand(folder) and read == []


def test_who_stops_while_100_gb_are_hashed_does_not_lose_them(film, monkeypatch):
    """Saved every minute (here: after each file), so that a later run goes on where this one stopped."""
    folder, cache, read = film
    monkeypatch.setattr(stamps, "SAVE_EVERY_S", -1.0)
    hashed = stamps.sha256

    def stops(f):
        if f.name == NAMES[2]:
            raise KeyboardInterrupt
        return hashed(f)

    monkeypatch.setattr(stamps, "sha256", stops)
    with pytest.raises(KeyboardInterrupt):
        Stamps(cache).of_recording(folder)
    monkeypatch.setattr(stamps, "sha256", hashed)
    del read[:]
    assert Stamps(cache).of_recording(folder) == by_hand(folder)
    assert sorted(read) == NAMES[2:]


def test_files_of_a_pattern_and_headers_belong_to_a_recording(film):
    folder, cache, _ = film
    known = Stamps(cache)
    known.of_recording(folder / "[ab]*.png")
    assert [os.path.basename(f) for f, _, _ in known.recordings[folder / "[ab]*.png"]] == NAMES[:2]
    (folder / "shot.mraw").write_text("film")
    (folder / "shot.cihx").write_text("header")
    known.of_recording(folder / "shot.mraw")
    assert [os.path.basename(f) for f, _, _ in known.recordings[folder / "shot.mraw"]] == ["shot.cihx", "shot.mraw"]


def test_a_file_that_changes_all_the_time_is_refused(film, monkeypatch):
    folder, cache, _ = film

    def written(f):
        f.write_text(f.read_text() + "more")
        return "00" * 32

    monkeypatch.setattr(stamps, "sha256", written)
    with pytest.raises(InputError, match=r"a\.png: changes while it is read; run again"):
        Stamps(cache).of_recording(folder)

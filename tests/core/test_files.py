"""A file is replaced whole or not at all, whoever writes it and however the writing ends."""

import errno
import stat
import threading
from pathlib import Path

import pytest

from pido.core.files import refusal, replacing, write_atomically


def test_a_failed_write_leaves_the_old_content_and_nothing_else(tmp_path):
    path = tmp_path / "new folder" / "a.json"
    write_atomically(path, "µ")
    with pytest.raises(UnicodeEncodeError), replacing(path) as temporary:
        temporary.write_text("half a line, then µ", encoding="ascii")
    assert path.read_bytes() == "µ".encode()
    assert list(path.parent.iterdir()) == [path]


def test_what_only_its_owner_may_read_is_never_open_to_others(tmp_path, monkeypatch):
    before_it_has_its_name = []
    replace = Path.replace

    def watched(path, target):
        before_it_has_its_name.append(stat.S_IMODE(path.stat().st_mode))
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", watched)
    write_atomically(tmp_path / "secrets.env", "PASSWORD=a", 0o600)
    assert before_it_has_its_name == [0o600]


def test_a_reader_never_sees_a_part_of_what_several_threads_write(tmp_path):
    path = tmp_path / "a"
    write_atomically(path, b"0" * 100_000)
    threads = [
        threading.Thread(target=lambda k=k: [write_atomically(path, str(k) * 100_000) for _ in range(5)])
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        content = path.read_bytes()
        assert len(content) == 100_000
        assert len(set(content)) == 1


def test_an_error_of_the_disk_that_names_no_file_is_told_with_the_one_that_was_to_be_written(tmp_path):
    with pytest.raises(OSError, match="No space left") as full, replacing(tmp_path / "model.skops"):
        raise OSError(errno.ENOSPC, "No space left on device")
    said = f"{tmp_path / 'model.skops'}: No space left on device. Make room there, or name another place."
    assert refusal(full.value) == said

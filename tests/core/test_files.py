"""A file is replaced whole or not at all, whoever writes it and however the writing ends."""

import threading

import pytest

from pido.core.files import replacing, write_atomically


def test_a_failed_write_leaves_the_old_content_and_nothing_else(tmp_path):
    path = tmp_path / "new folder" / "a.json"
    write_atomically(path, "µ")
    with pytest.raises(UnicodeEncodeError), replacing(path) as temporary:
        temporary.write_text("half a line, then µ", encoding="ascii")
    assert path.read_bytes() == "µ".encode()
    assert list(path.parent.iterdir()) == [path]


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

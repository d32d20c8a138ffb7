"""Download of the published weights, from a local server."""

import hashlib
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from occjax.errors import InputError
from occjax.models.occcasnet import published_weights
from occjax.models.occcasnet.published_weights import fetch_published_weights, git_blob_id

CONTENT = bytes(range(256)) * 1200
"""Content of the file, larger than one chunk of the download."""
BLOB_ID = hashlib.sha1(b"blob %d\0" % len(CONTENT) + CONTENT).hexdigest()


@contextmanager
def server(status=200, body=CONTENT, announced=None):
    """Run a local server with one answer; yields its URL and the list of requested paths."""
    requests = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            requests.append(self.path)
            if body is None:  # no answer
                threading.Event().wait(0.5)
                return
            self.send_response(status)
            if announced is not False:
                self.send_header("Content-Length", str(announced or len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *arguments):
            pass

    http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield f"http://127.0.0.1:{http.server_port}/weights.hdf5", requests
    http.shutdown()
    http.server_close()
    thread.join()


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch):
    monkeypatch.setenv("no_proxy", "*")


def fetch(url, cache):
    return fetch_published_weights(cache=cache, url=url, blob_id=BLOB_ID, progress=False)


def assert_refused(url, cache, message):
    with pytest.raises(InputError, match=message) as caught:
        fetch(url, cache)
    assert "\n" not in str(caught.value)
    assert list(cache.rglob("*")) == []


def test_file_is_downloaded_once(tmp_path):
    cache = tmp_path / "new" / "cache"
    with server() as (url, requests):
        path = fetch(url, cache)
        assert path.read_bytes() == CONTENT
        assert path.suffix == ".hdf5"
        assert list(cache.iterdir()) == [path]
        assert fetch(url, cache) == path
        assert len(requests) == 1
    assert fetch(url, cache) == path  # without a server


@pytest.mark.parametrize("damaged", [b"", CONTENT[:-1], CONTENT[:-1] + b"x"])
def test_damaged_file_in_the_cache_is_replaced(tmp_path, damaged):
    with server() as (url, requests):
        fetch(url, tmp_path).write_bytes(damaged)
        assert fetch(url, tmp_path).read_bytes() == CONTENT
    assert len(requests) == 2


def test_failed_download_keeps_the_file_in_the_cache(tmp_path):
    with server() as (url, _):
        fetch(url, tmp_path).write_bytes(b"damaged")
    with pytest.raises(InputError):
        fetch(url, tmp_path)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"damaged"]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            {"body": CONTENT[:100_000], "announced": len(CONTENT)},
            f"stopped after .* {len(CONTENT)}",
        ),
        ({"body": CONTENT[:100_000], "announced": False}, "is not the published one"),
        ({"body": CONTENT[::-1]}, f"is not the published one .* expected {BLOB_ID}"),
        ({"status": 404}, "answers 404 .Not Found."),
        ({"status": 500}, "answers 500 .Internal Server"),
        ({"body": None}, "cannot be downloaded|stopped after"),
    ],
    ids=["broken off", "truncated", "another file", "absent", "server error", "silent"],
)
def test_other_answers_are_refused(tmp_path, monkeypatch, answer, message):
    monkeypatch.setattr(published_weights, "TIMEOUT_SECONDS", 0.2)
    with server(**answer) as (url, _):
        assert_refused(url, tmp_path, message)


def test_unreachable_server_and_malformed_url_are_refused(tmp_path):
    with server() as (url, _):
        pass
    assert_refused(url, tmp_path, r"cannot be downloaded \(.*refused\); check network")
    assert_refused("weights.hdf5", tmp_path, r"weights.hdf5: cannot be downloaded")


def test_cache_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with server() as (url, requests), pytest.raises(InputError, match=r"file.*cannot be written"):
        fetch(url, tmp_path / "file")
    assert not requests


def test_notice_and_progress_go_to_standard_error(tmp_path, capsys):
    with server() as (url, _):
        fetch_published_weights(cache=tmp_path, url=url, blob_id=BLOB_ID)
    shown = capsys.readouterr()
    assert shown.out == ""
    for text in ("no licence", "Do not redistribute", "100%"):
        assert text in shown.err


def test_blob_id_is_that_of_git():
    """``printf 'what is up, doc?' | git hash-object --stdin``, from the book Pro Git."""
    assert git_blob_id(b"what is up, doc?") == "bd9dbf5aae1a3862dd1526723246b20206e5fc37"

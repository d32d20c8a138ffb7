import hashlib
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from occjax.errors import InputError
from occjax.models import fetch
from occjax.models.fetch import fetch_published_weights, git_blob_id

CONTENT = bytes(range(256)) * 1200
"""Larger than one chunk of the download."""
BLOB_ID = hashlib.sha1(b"blob %d\0" % len(CONTENT) + CONTENT).hexdigest()


class Server:
    """A local server with one answer for everything, which counts requests."""

    def __init__(self, status=200, body=CONTENT, announced=None):
        self.requests = 0
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                server.requests += 1
                self.send_response(status)
                if announced is not False:
                    self.send_header("Content-Length", str(announced or len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *arguments):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_port}/weights.hdf5"

    def __enter__(self):
        self.thread = threading.Thread(
            target=self.http.serve_forever, kwargs={"poll_interval": 0.01}
        )
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.http.shutdown()
        self.http.server_close()
        self.thread.join()


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch):
    """The local server is reached directly, whatever the environment says."""
    monkeypatch.setenv("no_proxy", "*")


def fetch_from(server, cache):
    return fetch_published_weights(cache=cache, url=server.url, blob_id=BLOB_ID, progress=False)


def assert_refused(server, cache, message):
    with pytest.raises(InputError, match=message) as caught:
        fetch_from(server, cache)
    assert "\n" not in str(caught.value)
    assert list(cache.rglob("*")) == []


def test_a_good_file_arrives_whole_under_a_name_that_says_its_format(tmp_path):
    with Server() as server:
        path = fetch_from(server, tmp_path / "new" / "cache")
    assert path.read_bytes() == CONTENT
    assert path.suffix == ".hdf5"
    assert list(path.parent.iterdir()) == [path]


def test_a_cached_file_is_not_fetched_again(tmp_path):
    with Server() as server:
        first, second = fetch_from(server, tmp_path), fetch_from(server, tmp_path)
    assert first == second
    assert server.requests == 1


def test_a_cached_file_needs_no_network(tmp_path):
    with Server() as server:
        path = fetch_from(server, tmp_path)
    assert fetch_from(server, tmp_path) == path


@pytest.mark.parametrize("damaged", [b"", CONTENT[:-1], CONTENT[:-1] + b"x"])
def test_a_damaged_cached_file_is_fetched_anew(tmp_path, damaged):
    with Server() as server:
        fetch_from(server, tmp_path).write_bytes(damaged)
        path = fetch_from(server, tmp_path)
    assert path.read_bytes() == CONTENT
    assert server.requests == 2


def test_a_failed_download_leaves_the_cached_file_alone(tmp_path):
    with Server() as server:
        fetch_from(server, tmp_path).write_bytes(b"damaged")
    with pytest.raises(InputError):
        fetch_from(server, tmp_path)
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"damaged"]


def test_a_download_that_breaks_off_is_refused(tmp_path):
    with Server(body=CONTENT[:100_000], announced=len(CONTENT)) as server:
        assert_refused(server, tmp_path, f"broke off after .* of {len(CONTENT)} bytes")


def test_a_truncated_file_of_unannounced_length_is_refused(tmp_path):
    with Server(body=CONTENT[:100_000], announced=False) as server:
        assert_refused(server, tmp_path, "delivered another file")


def test_a_wrong_file_of_the_right_length_is_refused(tmp_path):
    with Server(body=CONTENT[::-1]) as server:
        assert_refused(server, tmp_path, f"delivered another file .* expected {BLOB_ID}")


@pytest.mark.parametrize(
    ("status", "message"), [(404, "answers 404 .Not Found."), (500, "answers 500 .Internal Server")]
)
def test_a_server_error_is_refused(tmp_path, status, message):
    with Server(status=status) as server:
        assert_refused(server, tmp_path, message)


def test_without_network_the_cure_is_named(tmp_path):
    with Server() as server:
        pass
    assert_refused(server, tmp_path, r"cannot be downloaded \(.*refused\); check network")


def test_a_silent_server_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(fetch, "TIMEOUT_SECONDS", 0.2)
    with Server(body=b"", announced=100) as server:
        server.http.RequestHandlerClass.do_GET = lambda handler: threading.Event().wait(0.5)
        assert_refused(server, tmp_path, r"cannot be downloaded \(timed out\)")


def test_an_address_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"weights.hdf5: cannot be downloaded"):
        fetch_published_weights(cache=tmp_path, url="weights.hdf5", progress=False)


def test_a_cache_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with Server() as server, pytest.raises(InputError, match=r"file.*cannot be written"):
        fetch_from(server, tmp_path / "file")
    assert server.requests == 0


def test_notice_and_progress_go_to_standard_error(tmp_path, capsys):
    with Server() as server:
        fetch_published_weights(cache=tmp_path, url=server.url, blob_id=BLOB_ID)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "no licence" in shown.err
    assert "Do not redistribute" in shown.err
    assert "100%" in shown.err


def test_blob_id_is_what_git_says(tmp_path):
    (tmp_path / "file").write_bytes(CONTENT)
    try:
        git = subprocess.run(
            ["git", "hash-object", "--no-filters", tmp_path / "file"],
            capture_output=True,
            check=True,
            text=True,
        )
    except FileNotFoundError:
        pytest.skip("git is not installed")
    assert git_blob_id(tmp_path / "file") == git.stdout.strip() == BLOB_ID

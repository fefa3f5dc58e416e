"""A server on 127.0.0.1 that answers as the Hugging Face Hub does for one repository, and ends with its block."""

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import NamedTuple

COMMIT = "c" * 40


class Hub(NamedTuple):
    """Where it listens, and the files that were downloaded."""

    url: str
    downloaded: list[str]


@contextmanager
def hub_server(repository: str, files: Mapping[str, bytes]) -> Iterator[Hub]:
    """Serves the API's description of a revision, the tree of its files, and the files."""
    downloaded = []

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_):
            pass

        def answer(self, status, content, headers=()):
            self.send_response(status)
            for name, value in headers:
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            if self.command == "GET":
                self.wfile.write(content)

        def do_GET(self):
            path, file = self.path.partition("?")[0], self.path.rpartition("/")[2]
            tree = [
                {"type": "file", "path": name, "size": len(content), "oid": "0"}
                for name, content in files.items()
            ]
            description = {
                "id": repository,
                "sha": COMMIT,
                "siblings": [{"rfilename": name} for name in files],
            }
            if path.startswith(f"/api/models/{repository}/tree/"):
                return self.answer(
                    200, json.dumps(tree).encode(), [("Content-Type", "application/json")]
                )
            if path.startswith(f"/api/models/{repository}"):
                return self.answer(
                    200, json.dumps(description).encode(), [("Content-Type", "application/json")]
                )
            if path.startswith(f"/{repository}/resolve/") and file in files:
                if self.command == "GET":
                    downloaded.append(file)
                digest = sha256(files[file]).hexdigest()
                return self.answer(
                    200, files[file], [("ETag", f'"{digest}"'), ("X-Repo-Commit", COMMIT)]
                )
            return self.answer(404, b"{}", [("X-Error-Code", "RepoNotFound")])

        def do_HEAD(self):
            self.do_GET()

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield Hub(f"http://127.0.0.1:{server.server_port}", downloaded)
    finally:
        server.shutdown()
        server.server_close()
        thread.join()

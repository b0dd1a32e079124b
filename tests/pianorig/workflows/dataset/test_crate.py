"""The RO-Crate validator on the data set's metadata, where that package is installed (`pip install roc-validator`).

It fetches the JSON-LD context from w3id.org; here the few terms that the crate uses stand in for it, so that no test
needs a network.
"""

from __future__ import annotations

import email
import io
import json
import urllib.request
from typing import Any

import pytest

from pianorig.workflows.dataset.describe import ro_crate

services = pytest.importorskip("rocrate_validator.services")
models = pytest.importorskip("rocrate_validator.models")
http = pytest.importorskip("rocrate_validator.utils.http")

TERMS = (
    *("name", "description", "datePublished", "version", "keywords", "license", "creator", "publisher", "hasPart"),
    *("encodingFormat", "contentSize", "sha256", "about", "CreativeWork", "Dataset", "Organization"),
)
CONTEXT = {
    "@context": {
        **{term: f"http://schema.org/{term}" for term in TERMS},
        "File": "http://schema.org/MediaObject",
        "conformsTo": "http://purl.org/dc/terms/conformsTo",
    }
}
FILES = {"README.md": b"card\n", "dataset.json": b"{}\n", "open/trial_0001.nc": b"netcdf\n"}


class Answer:
    """What w3id.org would answer."""

    status_code, ok, url = 200, True, "https://w3id.org/ro/crate/1.3/context"
    headers = {"Content-Type": "application/ld+json"}
    text = json.dumps(CONTEXT)
    content = text.encode()

    def json(self) -> dict[str, Any]:
        return CONTEXT

    def raise_for_status(self) -> None:
        return None


def opened(*_: Any, **__: Any) -> io.BytesIO:
    """The same for urllib."""
    stream = io.BytesIO(Answer.content)
    stream.headers = email.message_from_string("Content-Type: application/ld+json\n\n")  # type: ignore[attr-defined]
    stream.url, stream.code = Answer.url, 200  # type: ignore[attr-defined]
    stream.geturl, stream.info = (lambda: Answer.url), (lambda: stream.headers)  # type: ignore[attr-defined]
    return stream


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of rdflib, in itself
def test_every_required_check_of_the_profile_passes(tmp_path, monkeypatch) -> None:
    for name, content in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / "ro-crate-metadata.json").write_text(json.dumps(ro_crate(FILES)))
    monkeypatch.setattr(http.HttpRequester, "get", lambda *_, **__: Answer(), raising=False)
    monkeypatch.setattr(http.HttpRequester, "head", lambda *_, **__: Answer(), raising=False)
    monkeypatch.setattr(urllib.request, "urlopen", opened)
    settings = models.ValidationSettings(
        rocrate_uri=str(tmp_path), profile_identifier="ro-crate-1.3", requirement_severity=models.Severity.REQUIRED
    )
    assert [issue.message for issue in services.validate(settings).get_issues(models.Severity.REQUIRED)] == []

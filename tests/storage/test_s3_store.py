"""Shards put into a bucket: requests that fail, processes that are killed, other machines, other datasets."""

import json
import os
import pickle
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from mmw.storage import s3_store as bucket
from mmw.storage.atomic_files import StoreError
from mmw.storage.file_checks import verify
from mmw.storage.lock import remove_leftovers, writing
from mmw.storage.manifest import pending_shards, prepare_root, read_dataset, upload_finished
from mmw.storage.s3_store import MAX_SINGLE_PUT_BYTES, Bucket
from mmw.storage.shard_writer import ShardKey, marker_path
from mmw.storage.store import store_of
from tests.fixtures.bucket_data import KEYS, PUTS, TABLES, make
from tests.fixtures.s3_server import Answer, Server, puts, s3, server
from tests.fixtures.shards import IDENTITY, META

__all__ = ["s3", "server"]


def data_of(objects: dict[str, bytes]) -> dict[str, bytes]:
    """Return the tables among the files of a dataset."""
    return {name: data for name, data in objects.items() if name.endswith(".parquet") and name[0] != "_"}


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Tables of the same dataset in a folder."""
    root = tmp_path_factory.mktemp("local")
    make(store_of(root))
    return data_of({path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.parquet")})


def refused(words: str) -> Callable[[str, str], Answer]:
    """Return what refuses to put objects whose keys hold some words."""
    return lambda method, path: (403, "AccessDenied") if method == "PUT" and words in path else None


def test_the_marker_goes_last(server: Server, tmp_path: Path) -> None:
    make(Bucket(server.address("last"), tmp_path))
    order = puts(server.requests)
    for key in KEYS:
        last = order.index(f"last/{marker_path(key).as_posix()}")
        own = [i for i, name in enumerate(order) if f"weather={key.weather}" in name]
        assert len(own) == len(TABLES) and max(own) < last


def test_asking_what_is_done_takes_few_requests(server: Server, tmp_path: Path, monkeypatch) -> None:
    """Two listings, and a reading of each marker that is there; none of a file, none of a marker that is not."""
    monkeypatch.setattr(bucket, "MAX_SINGLE_LOOKUPS", 3)
    root = Bucket(server.address("few"), tmp_path)
    make(root)
    many = [ShardKey("town_a", "sunny", i, i + 1) for i in range(100, 300)]
    server.requests.clear()
    assert pending_shards(root, [*KEYS, *many]) == many
    assert len([path for _, path in server.requests if "?list-type" in path]) == 2
    assert len(server.requests) == 2 + 2 * (1 + len(KEYS))  # a reading of an object takes two


@pytest.mark.parametrize("number", range(1, PUTS + 1))
@pytest.mark.parametrize("kind", ["before", "after"])
def test_every_put_may_fail(server: Server, local: dict[str, bytes], tmp_path: Path, kind: str, number: int) -> None:
    """The n-th put is refused, or done and its answer lost: what a marker names is there at every moment, and a rerun
    completes the dataset."""
    name, left = f"fail-{kind}-{number}", count(1)

    def fail(method: str, path: str) -> Answer:
        assert server.false_markers(name) == []
        return (403, "AccessDenied") if method == "PUT" and next(left) == number else None

    setattr(server, kind, fail)
    with pytest.raises((StoreError, ValueError), match=f"s3://bucket/{name}/.*: cannot be written: permission is"):
        make(Bucket(server.address(name), tmp_path))
    there = data_of(server.objects(name))
    assert {path: local[path] for path in there} == there  # whole, marker or not
    setattr(server, kind, lambda method, path: _checked(server.false_markers(name)))
    make(Bucket(server.address(name), tmp_path))
    assert data_of(server.objects(name)) == local
    assert server.false_markers(name) == [] and len(server.objects(name)) == PUTS


def test_what_was_finished_here_is_put_and_not_made_again(server: Server, tmp_path: Path, monkeypatch) -> None:
    server.before = refused("sunny.000000.json")
    with pytest.raises(StoreError, match=r"_shards/town_a.sunny.000000.json: cannot be written"):
        make(Bucket(server.address("kept"), tmp_path))
    server.reset()
    root = Bucket(server.address("kept"), tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("tests.fixtures.bucket_data.write_shard", lambda *_: pytest.fail("made again"))
        make(root)
    assert puts(server.requests) == [
        "kept/dataset.json", *(f"kept/{name}/scenario=town_a/weather=sunny/part-000000.parquet" for name in TABLES),
        "kept/_shards/town_a.sunny.000000.json",
    ]  # fmt: skip
    assert verify(root) == []


def test_what_another_dataset_left_here_is_not_put(server: Server, tmp_path: Path) -> None:
    """The dataset is removed from the bucket after a failure, and begun again: nothing of before comes into it."""
    server.before = refused("sunny.000000.json")
    with pytest.raises(StoreError):
        make(Bucket(server.address("anew"), tmp_path))
    assert len(list(tmp_path.rglob("town_a.sunny.000000.json"))) == 1
    server.reset()
    Bucket(server.address("anew"), tmp_path).remove(["dataset.json", "_shards", *TABLES, "objects"])
    root = Bucket(server.address("anew"), tmp_path)
    prepare_root(root, IDENTITY, META["config_sha256"], {"mmw": "0.2.0"}, False)
    assert upload_finished(root, KEYS) == 0
    assert not list(tmp_path.rglob("town_a.sunny.000000.json"))


def test_a_request_is_tried_again(server: Server, local: dict[str, bytes], tmp_path: Path) -> None:
    """Each object fails at first, as under load; the S3 client itself does not try again what this error says."""
    tried: set[str] = set()

    def fail_once(method: str, path: str) -> Answer:
        name = path.partition("?")[0]
        if method != "PUT" or name in tried:
            return None
        tried.add(name)
        return 409, "OperationAborted"

    server.before = fail_once
    root = Bucket(server.address("again"), tmp_path)
    make(root)
    assert data_of(server.objects("again")) == local and verify(root) == []
    assert len(puts(server.requests)) == 2 * PUTS


def test_what_fails_again_and_again_ends(server: Server, tmp_path: Path) -> None:
    server.before = lambda method, path: (409, "OperationAborted") if method == "PUT" and "/lidar/" in path else None
    with pytest.raises(StoreError, match=r"lidar/.*: cannot be written \(.*OperationAborted") as error:
        make(Bucket(server.address("ends"), tmp_path))
    assert "\n" not in str(error.value)
    assert len([path for path in puts(server.requests) if "/lidar/" in path]) == 1 + len(bucket.RETRY_DELAYS_S)
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)  # as it comes from a worker


@pytest.mark.parametrize("step", ["begin", "part", "complete"])
def test_a_large_object_is_there_whole_or_not_at_all(server: Server, tmp_path: Path, monkeypatch, step: str) -> None:
    """An upload in parts fails at each of its steps; Arrow would leave an empty object where it could not begin."""
    name = f"large-{step}"
    root = Bucket(server.address(name), tmp_path)
    make(root)
    data = os.urandom(1000) * 21_500
    root = Bucket(server.address(name), tmp_path)
    prepare_root(root, IDENTITY, META["config_sha256"], {"mmw": "0.1.0"}, False)
    (root.folder / "stages").mkdir()
    (root.folder / "stages/big.usdc").write_bytes(data)
    (root.folder / "stages/big.json").write_text("{}")

    def fail(method: str, path: str) -> Answer:
        is_at = {
            "begin": method == "POST" and path.endswith("?uploads"), "part": "partNumber=2" in path,
            "complete": method == "POST" and "?uploadId=" in path,
        }  # fmt: skip
        return (403, "AccessDenied") if is_at[step] else None

    server.before = fail
    with monkeypatch.context() as patch, pytest.raises(StoreError, match=r"big.usdc: cannot be written"):
        # Closed when it is collected, a stream of the other kind puts an empty object, which no test in one process
        # sees: Python is held meanwhile, and so is the server.
        patch.setitem(vars(root), "_single", None)
        root.upload(["stages/big.usdc"], "stages/big.json")
    assert not [path for path in server.objects(name) if path.startswith("stages/")]
    server.reset()
    root.upload(["stages/big.usdc"], "stages/big.json")
    assert server.objects(name)["stages/big.usdc"] == data and len(data) > 4 * MAX_SINGLE_PUT_BYTES
    assert any("partNumber=3" in path for _, path in server.requests)


def test_a_put_that_is_said_to_have_worked_and_is_not_there(server: Server, tmp_path: Path) -> None:
    server.before = lambda method, path: (200, "OK") if method == "PUT" and "/lidar/" in path else None
    with pytest.raises(
        StoreError, match=r"lidar/.*: cannot be written \(it is incomplete or missing after its upload\)"
    ):
        make(Bucket(server.address("liar"), tmp_path))
    assert server.false_markers("liar") == []
    assert list(server.objects("liar/_shards")) == ["town_a.json"]


def test_another_machine_goes_on(server: Server, local: dict[str, bytes], tmp_path: Path) -> None:
    first, second = (Bucket(server.address("moved"), tmp_path / name) for name in ("one", "other"))
    server.before = refused("weather=sunny")
    with pytest.raises(StoreError):
        make(first)
    server.reset()
    make(second)
    assert data_of(server.objects("moved")) == local and verify(second) == []
    assert [path for path in puts(server.requests) if "rainy" in path] == []


def test_another_configuration_is_refused_and_replaced(server: Server, tmp_path: Path) -> None:
    root = Bucket(server.address("whose"), tmp_path)
    make(root)
    root.write_atomically("notes.txt", b"mine")
    root.write_atomically("mine/notes.txt", b"mine")
    before = server.objects("whose")
    with pytest.raises(ValueError, match=r"belongs to configuration cccccccccccc.*seed: 42 -> 7; use --overwrite"):
        make(Bucket(server.address("whose"), tmp_path), seed=7)
    assert server.objects("whose") == before
    server.before = lambda method, path: _checked(server.false_markers("whose"))
    make(Bucket(server.address("whose"), tmp_path), overwrite=True, seed=7)
    server.reset()
    after = server.objects("whose")
    assert json.loads(after["dataset.json"])["config"]["seed"] == 7
    assert after["notes.txt"] == after["mine/notes.txt"] == b"mine"
    assert set(after) == set(before)
    assert verify(Bucket(server.address("whose"))) == []


def _checked(wrong: list[str]) -> None:
    assert wrong == []


def test_a_place_that_holds_something_else_is_refused(server: Server, tmp_path: Path) -> None:
    Bucket(server.address("thesis"), tmp_path).write_atomically("thesis.tex", b"mine")
    for overwrite in (False, True):
        with pytest.raises(ValueError, match=r"thesis\.tex but no dataset\.json"):
            make(Bucket(server.address("thesis"), tmp_path), overwrite=overwrite)
    with pytest.raises(ValueError, match=r"s3://bucket/none: has no dataset\.json"):
        read_dataset(server.address("none"))


def test_a_dataset_that_another_part_begins_at_the_same_time_is_taken_up(server: Server, tmp_path: Path) -> None:
    make(Bucket(server.address("first"), tmp_path))
    head, looks = server.objects("first")["dataset.json"], count(1)

    def begin(method: str, path: str) -> None:
        if "list-type" in path and next(looks) == 2:  # this part has seen nothing there yet
            for name, data in (("dataset.json", head), ("config.yaml", b"")):
                server.backend.put_object("bucket", f"race/{name}", data)

    server.before = begin
    root = Bucket(server.address("race"), tmp_path, "1-of-2")
    make(root)
    assert next(looks) >= 3 and server.objects("race")["dataset.json"] == head and verify(root) == []


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ((403, "AccessDenied"), "permission is denied .*AWS_ACCESS_KEY_ID"),
        ((403, "InvalidAccessKeyId"), "credentials are not accepted .*AWS_PROFILE"),
        ((403, "SignatureDoesNotMatch"), "credentials are not accepted"),
        ((400, "ExpiredToken"), "credentials are not accepted"),
        ((301, "PermanentRedirect"), "in another region .*region=NAME"),
    ],
)
@pytest.mark.parametrize("method", ["GET", "PUT"])
def test_a_bucket_that_refuses_is_said_at_once(server: Server, tmp_path: Path, answer, words: str, method: str) -> None:
    server.before = lambda used, path: answer if used == method else None
    with pytest.raises(ValueError, match=f"^s3://bucket/start.*: cannot be (listed|written): .*{words}") as error:
        make(Bucket(server.address("start"), tmp_path))
    assert "\n" not in str(error.value) and server.objects("start") == {}
    assert len([1 for used, _ in server.requests if used == method]) == 1


@pytest.mark.slow
def test_a_store_that_cannot_be_reached(s3: Server, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^s3://bucket/x: cannot be listed: it cannot be reached .*endpoint_override"):
        make(Bucket("s3://bucket/x?endpoint_override=http://127.0.0.1:9&region=us-east-1", tmp_path))


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("gs://bucket/x", "is not the address of a dataset; give a folder or s3://"),
        ("s3:///x", "is not the address of a dataset"),
        ("s3://key:secret@bucket/x", "credentials must not be in an address"),
        ("s3://bucket/x?regoin=a", "Unexpected query parameter"),
    ],
)
def test_an_address_that_names_no_place(s3: Server, tmp_path: Path, address: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as error:
        make(store_of(address, tmp_path))
    assert "secret" not in str(error.value) and "\n" not in str(error.value)


def test_where_files_are_made(s3: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rerun finds its folder; other addresses have others; what is not one's own is left alone."""
    monkeypatch.setattr(bucket, "cache_dir", lambda: tmp_path / "cache")
    one, same, other = (Bucket(s3.address(key)) for key in ("town/a", "town/a/", "town/b"))
    assert one.staging == same.staging != other.staging
    assert one.staging.parent == tmp_path / "cache/mmw/staging" and one.staging.name.startswith("bucket-town-a-")
    given = Bucket(s3.address("town/a"), tmp_path / "disk")
    assert given.staging == tmp_path / "disk" / one.staging.name
    (given.staging / "mine").mkdir(parents=True)
    stale = given.staging / "0123456789ab.1-of-3"
    stale.mkdir()
    for part, is_left in (("0-of-3", True), ("1-of-3", False)):
        parted = Bucket(s3.address("town/a"), tmp_path / "disk", part)
        prepare_root(parted, IDENTITY, META["config_sha256"], {}, False)
        assert stale.is_dir() == is_left and parted.folder.name.endswith(f".{part}")
    assert (given.staging / "mine").is_dir() and given.staging / "mine" not in parted.folder.parents


def test_what_a_killed_run_on_ray_left_is_removed(server: Server, tmp_path: Path) -> None:
    """Its nodes look for a file in `_locks`; of other parts nobody knows whether they run."""
    root = Bucket(server.address("probe"), tmp_path)
    make(root)
    for part in ("0of2", "1of2", "0of1"):
        root.write_atomically(f"_locks/.ray.{part}-0123456789ab-0123456789ab.tmp", b"")
    with writing(root, 1, 2, pytest.fail):
        remove_leftovers(root, 1, 2)
    assert root.names("_locks") == ["_locks/.ray.0of2-0123456789ab-0123456789ab.tmp"]
    with writing(root, 0, 1, pytest.fail):
        remove_leftovers(root, 0, 1)
    assert root.names("_locks") == []
    assert verify(root) == []

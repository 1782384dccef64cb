"""Logs in object storage, from a server that speaks its protocol."""

import io

import boto3
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from moto.server import ThreadedMotoServer

import gpszip
from gpszip.cli.main import main

pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture(scope="module")
def endpoint():
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    url = f"http://{host}:{port}"
    access = {
        "aws_access_key_id": "key",
        "aws_secret_access_key": "secret",
        "region_name": "us-east-1",
    }
    storage = boto3.client("s3", endpoint_url=url, **access)
    storage.create_bucket(Bucket="logs")
    for number in range(3):
        body = io.BytesIO()
        along = np.arange(100.0)
        pq.write_table(
            pa.table(
                {"track_id": [str(number)] * 100, "t": along, "x": along, "y": np.full(100, number)}
            ),
            body,
        )
        storage.put_object(Bucket="logs", Key=f"day/{number}.parquet", Body=body.getvalue())
    storage.put_object(Bucket="logs", Key="day/damaged.parquet", Body=b"PAR1 and no more")
    yield url
    server.stop()


@pytest.fixture
def compress(endpoint, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("AWS_ENDPOINT_URL", endpoint)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    target = tmp_path / "day.gpsz"

    def call(*arguments):
        capfd.readouterr()
        code = main(["compress", *arguments, "-o", str(target), "--rmse", "1m", "--effort", "1"])
        return code, capfd.readouterr().err, target

    return call


@pytest.mark.parametrize("memory", [[], ["--memory", "500MiB"]])
def test_objects_are_compressed(compress, memory):
    code, stderr, target = compress("s3://logs/day/[0-9].parquet", *memory)
    assert code == 0, stderr
    assert gpszip.open(target).ids == ("0", "1", "2")


@pytest.mark.parametrize("memory", [[], ["--memory", "500MiB"]])
def test_damaged_object_is_refused_or_left_out_by_name(compress, memory):
    code, stderr, target = compress("s3://logs/day/*.parquet", *memory)
    assert code == 1
    assert "s3://logs/day/damaged.parquet" in stderr
    assert not target.exists()
    code, stderr, target = compress("s3://logs/day/*.parquet", "--skip-bad", *memory)
    assert code == 3
    assert "s3://logs/day/damaged.parquet" in stderr
    assert len(gpszip.open(target).ids) == 3


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("s3://nowhere/day/*.parquet", "there is no bucket 'nowhere'"),
        ("s3://logs/day/nine.parquet", "no such file"),
        ("s3://logs/night/*.parquet", "no file matches this pattern"),
    ],
)
def test_missing_objects_are_named(compress, name, words):
    code, stderr, _ = compress(name)
    assert code == 1
    assert f"{name}: {words}" in stderr


def test_missing_credentials_are_reported(compress, monkeypatch, tmp_path):
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    monkeypatch.setenv("HOME", str(tmp_path))
    code, stderr, _ = compress("s3://logs/day/0.parquet")
    assert code == 1
    assert "access denied; check AWS_ACCESS_KEY_ID" in stderr

"""Rows of the view `paths` and the tables `links` and `poses` as arrays of links."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from mmw.channel import CarrierPaths, PlanarArray, apply_arrays, rotations_from_poses, ula
from mmw.channel.path_table import LINK_COLUMNS, PATH_COLUMNS
from mmw.core.transforms import quaternion_to_matrix
from mmw.storage.schemas import table_spec, views
from tests.fixtures.path_tables import link_table, path_table, pose_table


def test_columns_are_those_of_the_tables() -> None:
    assert set(PATH_COLUMNS) <= {column.name for column in views()["paths"].columns}
    assert set(LINK_COLUMNS) <= {column.name for column in table_spec("links").columns}


@pytest.mark.parametrize("kind", ["arrow", "pandas", "mapping"])
def test_rows_are_grouped_by_link(kind: str) -> None:
    table = path_table()
    rows = table.to_pylist()
    given = {
        "arrow": table,
        "pandas": table.to_pandas(),
        "mapping": {k: table[k].to_pylist() for k in table.column_names},
    }
    paths = CarrierPaths.from_table(given[kind], 28e9)
    assert len(paths) == sum(row["carrier_hz"] == 28e9 for row in rows) and paths.carrier_hz == 28e9
    links = {tuple(key) for key in paths.keys.tolist()}
    assert len(links) == paths.link_count == len(paths.path_count) and paths.path_count.min() > 0
    for p in range(len(paths)):
        row = rows[paths.row[p]]
        assert tuple(paths.keys[paths.link[p]]) == tuple(row[name] for name in LINK_COLUMNS[:-1])
        t = paths.transfer[p]
        assert t[0, 1] == row["t_tp_re"] + 1j * row["t_tp_im"] and t[1, 0] == row["t_pt_re"] + 1j * row["t_pt_im"]
        assert t[0, 0] == row["t_tt_re"] + 1j * row["t_tt_im"] and t[1, 1] == row["t_pp_re"] + 1j * row["t_pp_im"]
        assert paths.a[p] == row["a_re"] + 1j * row["a_im"] and paths.tau[p] == row["tau_s"]
        angles = (paths.theta_t[p], paths.phi_t[p], paths.theta_r[p], paths.phi_r[p])
        assert angles == (row["aod_ze"], row["aod_az"], row["aoa_ze"], row["aoa_az"])
        assert paths.doppler_hz[p] == row["doppler_hz"] and paths.is_los[p] == (row["order"] == 0)
    for link in range(paths.link_count):  # rows of a link keep their order
        assert (np.diff(paths.row[paths.link == link]) > 0).all()


def test_links_without_paths_come_from_the_links_table() -> None:
    table = path_table()
    links = link_table(table)
    alone, paths = CarrierPaths.from_table(table, 28e9), CarrierPaths.from_table(table, 28e9, links)
    assert paths.link_count == alone.link_count + 1
    assert (
        paths.keys[0].tolist() == ("town_a", "sunny", 9, "cav_1", "rsu_1", "antenna", "roof")
        and paths.path_count[0] == 0
    )
    kept = links.filter(pc.equal(links["carrier_hz"], 28e9))
    assert [tuple(row.values())[:-1] for row in kept.to_pylist()] == paths.keys.tolist()
    by_row = dict(zip(alone.row, alone.keys[alone.link], strict=True))
    assert all(by_row[row] == paths.keys[link] for row, link in zip(paths.row, paths.link, strict=True))
    empty = CarrierPaths.from_table(table.slice(0, 0), 28e9, links)
    assert len(empty) == 0 and empty.link_count == paths.link_count
    one = PlanarArray()
    assert apply_arrays(empty, ula(4), one, 28e9).shape == (0, 1, 4)


def test_take_is_a_smaller_table() -> None:
    paths = CarrierPaths.from_table(path_table(), 28e9)
    some = paths.take([4, 1])
    assert some.keys.tolist() == paths.keys[[4, 1]].tolist()
    np.testing.assert_array_equal(some.row, np.concatenate([paths.row[paths.link == n] for n in (4, 1)]))
    np.testing.assert_array_equal(some.tau, np.concatenate([paths.tau[paths.link == n] for n in (4, 1)]))
    mask = paths.keys["scenario"] == "town_b"
    assert set(paths.take(mask).keys["scenario"]) == {"town_b"} and paths.take(mask).link_count == mask.sum()
    with pytest.raises(ValueError, match="more than once"):
        paths.take([1, 1])


def test_row_errors() -> None:
    table = path_table()
    with pytest.raises(ValueError, match=r"carriers 4\.9e\+09, 2\.8e\+10 Hz; CarrierPaths holds one"):
        CarrierPaths.from_table(table)
    with pytest.raises(ValueError, match=r"carrier_hz = 6e\+10: the tables hold 4\.9e\+09, 2\.8e\+10 Hz"):
        CarrierPaths.from_table(table, 60e9)
    with pytest.raises(ValueError, match=r"table paths: columns \['tau_s', 'doppler_hz'\] are missing"):
        CarrierPaths.from_table(table.drop_columns(["tau_s", "doppler_hz"]), 28e9)
    with pytest.raises(ValueError, match=r"table links: columns \['peer'\] are missing"):
        CarrierPaths.from_table(table, 28e9, link_table(table).drop_columns(["peer"]))
    links = link_table(table)
    with pytest.raises(ValueError, match=r"table links: 1 links of paths have no row in it, the first \{'scenario'"):
        row = next(i for i, c in enumerate(links["carrier_hz"].to_pylist()) if c == 28e9 and i > 0)
        CarrierPaths.from_table(table, 28e9, pa.concat_tables([links.slice(0, row), links.slice(row + 1)]))
    with pytest.raises(ValueError, match="1 rows repeat a link"):
        CarrierPaths.from_table(table, 28e9, pa.concat_tables([links, links.slice(0, 1)]))
    frame = table.to_pandas()
    frame["tau_s"] = frame["tau_s"].where(np.arange(len(frame)) != 7)
    with pytest.raises(ValueError, match="column tau_s: row 7 is null"):
        CarrierPaths.from_table(frame, 28e9)
    with pytest.raises(ValueError, match="carriers none Hz"):
        CarrierPaths.from_table(table.slice(0, 0))
    paths = CarrierPaths.from_table(table, 28e9)
    with pytest.raises(ValueError, match="sort the paths by link"):
        CarrierPaths(**{**vars(paths), "link": paths.link[::-1]})


def test_rotations_from_poses() -> None:
    paths = CarrierPaths.from_table(path_table(), 28e9)
    poses = pose_table().to_pandas()
    names = list(poses[["scenario", "frame", "agent"]].itertuples(index=False, name=None))
    q = poses[["qx", "qy", "qz", "qw"]].to_numpy()
    for which, column in (("tx", "peer"), ("rx", "agent")):
        rotation = rotations_from_poses(poses, paths, which)
        assert rotation.shape == (paths.link_count, 3, 3)
        for link, key in enumerate(paths.keys):
            row = names.index((key["scenario"], key["frame"], key[column]))
            expected = quaternion_to_matrix(q[row] / np.linalg.norm(q[row]))
            np.testing.assert_allclose(rotation[link], expected, atol=1e-15)
    with pytest.raises(ValueError, match=r"links have no pose of their tx, the first rsu_1 in scenario town_"):
        rotations_from_poses(poses[poses["agent"] != "rsu_1"], paths, "tx")
    with pytest.raises(ValueError, match="are one agent in one frame"):
        rotations_from_poses(pd.concat([poses, poses.tail(1)]), paths, "rx")
    with pytest.raises(ValueError, match=r"table poses: columns \['qw'\] are missing"):
        rotations_from_poses(poses.drop(columns="qw"), paths, "rx")
    with pytest.raises(ValueError, match="which = 'both'"):
        rotations_from_poses(poses, paths, "both")

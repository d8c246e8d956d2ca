"""A small USD stage of a user, with a moving vehicle and a mast, and its configuration."""

from pathlib import Path

STAGE = """#usda 1.0
(
    defaultPrim = "World"
    endTimeCode = 9
    metersPerUnit = 1
    startTimeCode = 0
    timeCodesPerSecond = 100
    upAxis = "Z"
)

def Xform "World"
{
    def Mesh "Ground"
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)]
    }
    def Xform "Ego"
    {
        double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 9: (0.9, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "Body"
        {
        }
        def Mesh "Plate"
        {
            int[] faceVertexCounts = [4]
            int[] faceVertexIndices = [0, 1, 2, 3]
            point3f[] points = [(-2, -1, 1), (2, -1, 1), (2, 1, 1), (-2, 1, 1)]
        }
    }
    def Xform "Mast"
    {
        double3 xformOp:translate = (20, 5, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""
CONFIG = """
scenarios:
  - name: mine
    stage: mine.usda
    actor_roles: {/World/Ego: cav, /World/Mast: rsu}
    material_map: {"/World/*": itu_concrete}
frames: {count: 10}
sensors: [{type: lidar, channels: 8, points_per_channel: 64}, {type: imu}]
channel: {rays: 10_000}
"""
SMALL = ["output.shard_frames=2", "weathers=[sunny, rainy]"]


def write_own_world(folder: Path) -> Path:
    """Write `mine.usda` and `mine.yaml` into a folder and return it."""
    (folder / "mine.usda").write_text(STAGE)
    (folder / "mine.yaml").write_text(CONFIG)
    return folder


def command(folder: Path, out: str, *extra: str) -> list[str]:
    """Return the arguments of a run on the CPU: two frames a shard, two weathers."""
    return ["--config", str(folder / "mine.yaml"), *SMALL, "--out", str(folder / out), "--device", "cpu", *extra]


def assert_same_rows(one: Path, other: Path) -> None:
    """Every table file of two datasets has the same bytes."""
    first, second = (
        {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("part-*.parquet")}
        for root in (one, other)
    )
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == []

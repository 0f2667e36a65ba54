"""Bags without ROS: what is written, what other readers make of it, what survives damage."""

import resource
import struct
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Header, Metadata, Statistics
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from samples import examples
from test_fuzz_bags import read_all

from eulerparams_control.bags import Bag, BagWriter, recover
from eulerparams_control.bags.format import Topic
from eulerparams_control.bags.writer import message_definition
from eulerparams_control.errors import BagError

JAZZY = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/MultiDOFJointTrajectory"
LOG = "rcl_interfaces/msg/Log"
STRING = "std_msgs/msg/String"
URDF = "<robot name='r'/>"
PARAMETERS = {"/arm/clik": {"ros__parameters": {"k_Pp": 100.0, "gains": {"on": True}}}}
START = 1_700_000_000_000_000_000
CHUNK_MESSAGES = 20  # of small_bag

ENDLESS = {"sec": 9223372036, "nsec": 854775807}
USUAL = {  # of two publishers
    **{"history": "unknown", "depth": 0, "reliability": "reliable", "durability": "volatile"},
    **{"deadline": ENDLESS, "lifespan": ENDLESS, "liveliness": "automatic"},
    **{"liveliness_lease_duration": ENDLESS, "avoid_ros_namespace_conventions": False},
}
STATES = Topic("/arm/joint_states", JOINT_STATE, JAZZY.hash_rihs01(JOINT_STATE), (USUAL, USUAL))
DESCRIPTION = Topic(
    "/arm/robot_description",
    STRING,
    JAZZY.hash_rihs01(STRING),
    ({**USUAL, "durability": "transient_local"}, {**USUAL, "reliability": "best_effort"}),
)


def joint_state(number: int) -> bytes:
    """Return a JointState whose position is ``number``, serialised by rosbags."""
    types = JAZZY.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 2), "base")
    numbers = np.array([float(number)])
    message = types[JOINT_STATE](header, ["j"], numbers, np.zeros(1), np.zeros(1))
    return bytes(JAZZY.serialize_cdr(message, JOINT_STATE))


def string(text: str) -> bytes:
    return bytes(JAZZY.serialize_cdr(JAZZY.types[STRING](text), STRING))


def write_bag(folder: Path, messages: int) -> None:
    states = [joint_state(number) for number in range(messages)]
    with BagWriter(folder) as bag:
        bag.add_topic(DESCRIPTION)
        bag.add_topic(STATES)
        bag.write(DESCRIPTION.name, string(URDF), START, START - 5)
        bag.attach("parameters.yaml", yaml.safe_dump(PARAMETERS))
        for number, state in enumerate(states):
            stamp = START + number * 1_000_000
            bag.write(STATES.name, state, stamp, stamp - 7)
            if number % CHUNK_MESSAGES == 0:
                bag.flush()


def mcap_of(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


@pytest.fixture(scope="module")
def small_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole bag of 101 JointStates in several chunks; not to be changed."""
    folder = tmp_path_factory.mktemp("bags") / "small"
    write_bag(folder, 101)
    return folder


def rewritten(folder: Path, data: bytes) -> Path:
    """Return a new folder with only an MCAP file of this content: what a kill leaves."""
    folder.mkdir()
    mcap_of(folder).write_bytes(data)
    return folder


CHUNK, DATA_END, MESSAGE_INDEX = 6, 15, 7  # opcodes


def frames(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, first byte and end of each record of a whole file."""
    at = 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield opcode, at, at + 9 + length
        at += 9 + length


# --- what is written -----------------------------------------------------------------
FOREVER = "{sec: 9223372036, nsec: 854775807}"
PROFILE = (
    "{history: unknown, depth: 0, reliability: %s, durability: %s, liveliness: automatic, "
    f"deadline: {FOREVER}, lifespan: {FOREVER}, liveliness_lease_duration: {FOREVER}, "
    "avoid_ros_namespace_conventions: false}"
)

METADATA = f"""
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration: &duration {{nanoseconds: 100000000}}
  starting_time: &start {{nanoseconds_since_epoch: {START}}}
  message_count: 102
  topics_with_message_count:
  - topic_metadata:
      name: /arm/robot_description
      type: {STRING}
      serialization_format: cdr
      offered_qos_profiles:
      - {PROFILE % ("reliable", "transient_local")}
      - {PROFILE % ("best_effort", "volatile")}
      type_description_hash: {DESCRIPTION.type_hash}
    message_count: 1
  - topic_metadata:
      name: /arm/joint_states
      type: {JOINT_STATE}
      serialization_format: cdr
      offered_qos_profiles:
      - {PROFILE % ("reliable", "volatile")}
      - {PROFILE % ("reliable", "volatile")}
      type_description_hash: {STATES.type_hash}
    message_count: 101
  compression_format: ""
  compression_mode: ""
  relative_file_paths: [small_0.mcap]
  files: [{{path: small_0.mcap, duration: *duration, starting_time: *start, message_count: 102}}]
  custom_data:
  ros_distro: jazzy
"""


def test_metadata_yaml_has_every_key_of_version_9(small_bag):
    written = (small_bag / "metadata.yaml").read_text()
    assert yaml.safe_load(written) == yaml.safe_load(METADATA)
    assert "&" not in written  # anchors, which other readers may not know


def test_the_file_holds_the_records_that_rosbag2_writes(small_bag):
    with open(mcap_of(small_bag), "rb") as file:
        records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    assert isinstance(records[0], Header)
    assert records[0].profile == "ros2"
    notes = [record for record in records if isinstance(record, Metadata)]
    assert [note.name for note in notes] == ["rosbag2", "rosbag2"]
    opened, closed = (yaml.safe_load(note.metadata["serialized_metadata"]) for note in notes)
    outside = yaml.safe_load((small_bag / "metadata.yaml").read_text())
    assert closed == outside["rosbag2_bagfile_information"]
    assert records[1] is notes[0]
    assert opened["message_count"] == 0
    assert opened["topics_with_message_count"] == []
    assert opened["starting_time"] == {"nanoseconds_since_epoch": 2**63 - 1}
    assert {record.compression for record in records if isinstance(record, Chunk)} == {""}
    (statistics,) = (record for record in records if isinstance(record, Statistics))
    assert statistics.message_count == 102
    assert statistics.chunk_count >= 6
    channels = {record.topic: record for record in records if isinstance(record, Channel)}
    channel = channels[DESCRIPTION.name]
    assert channel.message_encoding == "cdr"
    assert channel.metadata.keys() == {"offered_qos_profiles", "topic_type_hash"}
    assert channel.metadata["topic_type_hash"] == DESCRIPTION.type_hash
    profiles = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert profiles == list(DESCRIPTION.qos_profiles)


def test_what_is_older_than_a_tenth_of_a_second_is_in_the_file(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(STATES)
    bag.write(STATES.name, joint_state(0), START, START)
    time.sleep(0.11)
    bag.write(STATES.name, joint_state(1), START, START)
    left = Bag(tmp_path / "bag")
    assert len(list(left.read_raw())) == left.metadata["message_count"] == 2
    bag.close()


def test_a_recorder_does_not_grow_with_the_chunks_that_it_ends(tmp_path):
    """And all of them are in the index at the end."""
    chunks = 3000
    tracemalloc.start()
    try:
        with BagWriter(tmp_path / "bag") as bag:
            bag.add_topic(STATES)
            for number in range(chunks):
                bag.write(STATES.name, b"", number, number)
                bag.flush()
                if number == 100:
                    before = tracemalloc.get_traced_memory()[0]
            grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 50_000  # in memory it would be 700 bytes a chunk
    with open(tmp_path / "bag/bag_0.mcap", "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    indexes = summary.chunk_indexes
    assert [index.message_start_time for index in indexes] == list(range(chunks))
    assert all(len(index.message_index_offsets) == 1 for index in indexes)


def test_rosbags_reads_every_message_in_order(small_bag):
    with AnyReader([small_bag]) as reader:
        (connection,) = (c for c in reader.connections if c.topic == STATES.name)
        assert connection.digest == JAZZY.hash_rihs01(JOINT_STATE)
        messages = [
            (stamp, reader.deserialize(raw, connection.msgtype).position[0])
            for _, stamp, raw in reader.messages([connection])
        ]
    assert messages == [(START + n * 1_000_000, float(n)) for n in range(101)]


def test_a_bag_lasts_from_its_first_to_its_latest_message_in_whatever_order_they_come(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(STATES)
        for received in (20, 10, 40, 30):
            bag.write(STATES.name, b"", received, received)
    told = Bag(tmp_path / "bag").metadata
    assert told["starting_time"]["nanoseconds_since_epoch"] == 10
    assert told["duration"]["nanoseconds"] == 30


@pytest.mark.parametrize("kind", [JOINT_STATE, STRING, TRAJECTORY, LOG])
def test_the_schema_text_hashes_to_the_type_hash_of_jazzy(kind):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_definition(kind), kind))
    assert store.hash_rihs01(kind) == JAZZY.hash_rihs01(kind)


def test_dependencies_follow_depth_first_and_sorted_each_once():
    parts = message_definition(TRAJECTORY).split("\n" + "=" * 80 + "\n")
    assert [part.splitlines()[0] for part in parts[1:]] == [
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
        "MSG: trajectory_msgs/MultiDOFJointTrajectoryPoint",
        "MSG: builtin_interfaces/Duration",
        "MSG: geometry_msgs/Transform",
        "MSG: geometry_msgs/Quaternion",
        "MSG: geometry_msgs/Vector3",
        "MSG: geometry_msgs/Twist",
    ]


def test_definitions_are_found_under_ament_prefix_path(tmp_path, monkeypatch):
    for name, text in (("Outer", "Inner[<=3] inner\n"), ("Inner", "float64 x # mm\n")):
        path = tmp_path / "share/my_msgs/msg" / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    separator = "=" * 80
    assert message_definition("my_msgs/msg/Outer") == (
        f"Inner[<=3] inner\n\n{separator}\nMSG: my_msgs/Inner\nfloat64 x # mm\n"
    )


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("no_msgs/msg/None", r"definition of no_msgs/msg/None is missing.*share/no_msgs/msg"),
        ("sensor_msgs/srv/SetCameraInfo", "expected package/msg/Type"),
        ("../../etc/msg/passwd", "expected package/msg/Type"),
    ],
)
def test_a_type_without_definition_is_refused(kind, words):
    with pytest.raises(BagError, match=words):
        message_definition(kind)


def test_an_existing_folder_is_not_overwritten(small_bag, tmp_path):
    before = mcap_of(small_bag).read_bytes()
    with pytest.raises(BagError, match="exists; nothing is overwritten: choose another folder"):
        BagWriter(small_bag)
    assert mcap_of(small_bag).read_bytes() == before
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"cannot make the bag .*: Not a directory"):
        BagWriter(tmp_path / "file" / "bag")


# --- what is read --------------------------------------------------------------------
def test_a_bag_tells_its_topics_messages_parameters_and_robot(small_bag):
    bag = Bag(small_bag)
    assert {name: (info.type, info.count) for name, info in bag.topics.items()} == {
        DESCRIPTION.name: (STRING, 1),
        STATES.name: (JOINT_STATE, 101),
    }
    assert bag.parameters() == PARAMETERS
    assert bag.robot_description() == URDF
    assert bag.metadata["message_count"] == 102
    assert (bag.truncated, bag.warning) == (False, "")
    first, *rest = bag.messages([STATES.name])
    assert (first.topic, first.log_time, first.publish_time) == (STATES.name, START, START - 7)
    assert first.message.header.frame_id == "base"
    assert [message.message.position[0] for message in rest] == list(range(1, 101))
    assert next(bag.read_raw()) == (DESCRIPTION.name, START, START - 5, string(URDF))


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"chunk_size": 768 * 1024}])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_bags_of_other_recorders_are_read(tmp_path, compression, options):
    """As by ros2 bag record: compressed or unchunked, other schema order, split, no hash."""
    separator = "\n" + "=" * 80 + "\n"
    root, *dependencies = message_definition(JOINT_STATE).split(separator)
    schema = separator.join([root, *reversed(dependencies)]).encode()
    for part in range(11):
        with open(tmp_path / f"split_{part}.mcap", "wb") as file:
            writer = Writer(file, compression=compression, enable_crcs=False, **options)
            writer.start("ros2")
            number = writer.register_schema(JOINT_STATE, "ros2msg", schema)
            channel = writer.register_channel("/joint_states", "cdr", number)
            writer.add_message(channel, START + part, joint_state(part), START)
            writer.finish()
    bag = Bag(tmp_path)
    assert [message.message.position[0] for message in bag.messages()] == list(range(11))
    assert bag.topics["/joint_states"].count == 11
    assert (bag.truncated, bag.parameters()) == (False, {})


def test_a_topic_that_is_not_there_is_refused_with_the_nearest_name(small_bag):
    with pytest.raises(BagError, match=r"no topic /arm/joint_state \(did you mean '/arm/joint_s"):
        Bag(small_bag).read_raw(["/arm/joint_state"])


@pytest.mark.parametrize(
    ("texts", "parameters"),
    [(["{a: {b: 1}}", "{a: {b: 2}}"], {"a": {"b": 2}}), (["[1, 2]"], {}), ([""], {}), (["a"], {})],
)
def test_parameters_are_of_the_last_attachment_if_it_has_their_form(tmp_path, texts, parameters):
    with BagWriter(tmp_path / "bag") as bag:
        for text in texts:
            bag.attach("parameters.yaml", text)
    assert Bag(tmp_path / "bag").parameters() == parameters


def test_two_robots_need_the_name_of_their_topic(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for side in ("left", "right"):
            bag.add_topic(Topic(f"/{side}/robot_description", STRING))
            bag.write(f"/{side}/robot_description", string(side), START, START)
    bag = Bag(tmp_path / "bag")
    with pytest.raises(BagError, match="several: /left/robot_description, /right/"):
        bag.robot_description()
    assert bag.robot_description("/right/robot_description") == "right"


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, "holds no .mcap file; expected the folder of a bag"),
        ({"a.db3": b""}, "sqlite3 bag; convert it"),
        ({"a.mcap.zstd": b""}, "decompress it"),
        ({"a.mcap": b""}, "is empty; expected an MCAP file"),
        ({"a.mcap": b"#ROSBAG V2.0"}, "expected an MCAP file"),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path, files, words):
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    for read in (Bag, recover):
        with pytest.raises(BagError, match=words):
            read(tmp_path)
    with pytest.raises(BagError, match="No such file"):
        Bag(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "data", [joint_state(1)[:-3], joint_state(1)[:48], string("a" * 20), b"", b"\0\1\0\0"]
)
def test_a_topic_that_cannot_be_decoded_is_named(tmp_path, data):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(STATES)
        bag.add_topic(Topic("/odd", STRING, serialization_format="json"))
        bag.write(STATES.name, data, START, START)
        bag.write("/odd", b"{}", START, START)
    bag = Bag(tmp_path / "bag")
    with pytest.raises(BagError, match=r"message of /arm/joint_states at \d+ ns cannot be decoded"):
        list(bag.messages([STATES.name]))
    with pytest.raises(BagError, match=r"/odd is encoded as json .* only cdr with ros2msg"):
        list(bag.messages(["/odd"]))
    assert len(list(bag.read_raw())) == 2


def test_batches_are_the_messages_by_topic(small_bag):
    bag, found = Bag(small_bag), {}
    for batch in bag.batches():
        for topic, messages in batch.items():
            rows = zip(messages.log_times, messages.publish_times, messages.data, strict=True)
            found.setdefault(topic, []).extend((topic, *row) for row in rows)
    assert found.keys() == {message.topic for message in bag.read_raw()}
    for topic, messages in found.items():
        assert messages == list(bag.read_raw([topic]))
    chosen = (batch.keys() for batch in bag.batches([DESCRIPTION.name]))
    assert {topic for topics in chosen for topic in topics} == {DESCRIPTION.name}


@pytest.mark.parametrize("options", [{"chunk_size": 512}, {"use_chunking": False}])
def test_messages_of_several_topics_keep_the_order_of_the_file(tmp_path, options):
    """As the reader of mcap has it, across chunks and batches."""
    path, names = mcap_of(tmp_path), ["/a", "/b", "/c"]
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, **options)
        writer.start("ros2")
        schema = writer.register_schema(STRING, "ros2msg", b"string data")
        channels = [writer.register_channel(name, "cdr", schema) for name in names]
        for k in range(3000):
            data = string(str(k) * (k % 50))
            writer.add_message(channels[k * k % 7 % 3], START - k, data, START + k)
        writer.finish()
    with open(path, "rb") as file:
        expected = [
            (channel.topic, message.log_time, message.publish_time, message.data)
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False)
        ]
    batches = list(Bag(tmp_path).batches())
    assert 2 < len(batches) < 10
    assert all(len(batch) == 3 for batch in batches)
    assert list(Bag(tmp_path).read_raw()) == expected


def test_a_topic_whose_definition_changes_between_files_is_refused(tmp_path):
    for name, kind in (("bag", STRING), ("other", JOINT_STATE)):
        with BagWriter(tmp_path / name) as written:
            written.add_topic(Topic("/odd", kind))
            data = string("text") if kind == STRING else joint_state(1)
            written.write("/odd", data, START, START)
    mcap_of(tmp_path / "other").rename(tmp_path / "bag/bag_1.mcap")
    bag = Bag(tmp_path / "bag")
    words = f"/odd has 2 definitions that differ, of {JOINT_STATE}, {STRING}; read its files one by"
    with pytest.raises(BagError, match=words):
        list(bag.messages())
    for name in ("bag_0.mcap", "bag_1.mcap"):
        assert len(list(Bag(tmp_path / "bag" / name).messages())) == 1


def test_reading_needs_little_memory_however_long_the_bag(tmp_path):
    write_bag(tmp_path / "bag", 20_000)
    size = mcap_of(tmp_path / "bag").stat().st_size
    tracemalloc.start()
    bag = Bag(tmp_path / "bag")
    assert sum(1 for _ in bag.read_raw()) == 20_001
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert size > 2.5e6
    assert peak < 1e6


# --- what survives -------------------------------------------------------------------
def content_of(folder: Path) -> dict[str, object]:
    """Return the bytes of each file of a folder, and when and how often it was changed."""
    found = {file.name: (file.read_bytes(), file.stat()) for file in folder.iterdir()}
    return {
        name: (data, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino, stat.st_mode)
        for name, (data, stat) in found.items()
    }


def test_of_a_whole_bag_no_other_one_is_made(tmp_path):
    write_bag(tmp_path / "bag", 5)
    before = content_of(tmp_path / "bag")
    result = recover(tmp_path / "bag")
    assert (result.bag, result.messages) == (tmp_path / "bag", 6)
    assert str(result).endswith("whole, 6 messages on 2 topics; no other bag was made")
    assert content_of(tmp_path / "bag") == before
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("flaw", ["cut", "damaged", "no metadata.yaml", "wrong metadata.yaml"])
def test_recovery_makes_a_bag_beside_the_other_and_changes_nothing_in_that(
    small_bag, tmp_path, flaw
):
    data = bytearray(mcap_of(small_bag).read_bytes())
    if flaw == "cut":
        data = data[: len(data) // 2]
    elif flaw == "damaged":
        data[data.index(joint_state(50)) + 30] ^= 1
    folder = rewritten(tmp_path / "bag", bytes(data))
    (folder / "bag_0.mcap").chmod(0o444)
    if flaw == "wrong metadata.yaml":
        (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {message_count: 2}")
    (folder / "notes.txt").write_text("of the person who recorded it")
    folder.chmod(0o555)
    found, before = list(Bag(folder).read_raw()), content_of(folder)
    for name in ("bag_recovered", "bag_recovered_2"):  # nothing is overwritten either
        result = recover(folder)
        assert (result.bag, result.messages) == (tmp_path / name, len(found))
        assert f"{folder}: unchanged; recovered {len(found)} messages on " in str(result)
        assert f"in {tmp_path / name}" in str(result)
        assert list(Bag(result.bag).read_raw()) == found
        assert sorted(file.name for file in result.bag.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    assert content_of(folder) == before
    folder.chmod(0o755)
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("text", [None, "", "rosbag2_bagfile_information: {message_count: 2}"])
def test_recovery_writes_metadata_yaml_anew(tmp_path, text):
    write_bag(tmp_path / "bag", 5)
    path = tmp_path / "bag" / "metadata.yaml"
    whole = path.read_text()
    path.unlink() if text is None else path.write_text(text)
    assert (recover(tmp_path / "bag").bag / "metadata.yaml").read_text() == whole


def test_damage_costs_the_chunk_that_it_is_in(small_bag, tmp_path):
    data = bytearray(mcap_of(small_bag).read_bytes())
    data[data.index(joint_state(50)) + 30] ^= 1
    bag = rewritten(tmp_path / "bag", bytes(data))
    broken = Bag(bag)
    numbers = [m.message.position[0] for m in broken.messages([STATES.name])]
    assert numbers == [n for n in range(101) if not 41 <= n <= 60]
    assert "left out the chunk at byte" in broken.warning
    result = recover(bag)
    assert result.messages == 82
    assert "; left out the chunk at byte" in str(result)
    assert [m.message.position[0] for m in Bag(result.bag).messages([STATES.name])] == numbers


def test_zeros_that_a_power_cut_left_are_cut_off(small_bag, tmp_path):
    data = mcap_of(small_bag).read_bytes()
    end = max(end for code, _, end in frames(data) if code == CHUNK)
    bag = rewritten(tmp_path / "bag", data[:end] + bytes(5000))
    result = recover(bag)
    assert (result.messages, result.lost) == (102, ("the last 5000 bytes",))


def test_damaged_parameters_are_refused(small_bag, tmp_path):
    data = mcap_of(small_bag).read_bytes()
    bag = rewritten(tmp_path / "bag", data.replace(b"k_Pp: 100.0", b"k_Pp: 900.0"))
    with pytest.raises(BagError, match=r"attachment .* is damaged: its checksum is wrong"):
        Bag(bag).parameters()
    result = recover(bag)
    assert "left out the attachment" in str(result)
    assert Bag(result.bag).parameters() == {}


def test_recovery_refuses_a_bag_that_is_being_recorded(tmp_path):
    with BagWriter(tmp_path / "bag"), pytest.raises(BagError, match="is being recorded"):
        recover(tmp_path / "bag")
    assert recover(tmp_path / "bag").bag == tmp_path / "bag"


def test_recovery_runs_where_ros_is_not_installed(small_bag, tmp_path):
    killed = rewritten(tmp_path / "killed", mcap_of(small_bag).read_bytes()[:-40])
    program = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from eulerparams_control.bags.recorder import main\n"
        "sys.exit(main())"
    )
    command = [sys.executable, "-c", program, "--recover", killed, tmp_path / "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    said = f"{killed}: unchanged; recovered 102 messages on 2 topics in {killed}_recovered\n"
    assert done.stdout == said
    assert done.stderr.startswith(f"error: {tmp_path}/nowhere is no folder; expected")
    assert done.stderr.count("\n") == 1


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Let writes beyond ``size`` bytes fail, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_costs_the_last_chunk_and_is_told(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.add_topic(STATES)
    state = joint_state(0)

    def fill() -> None:
        for number in range(10_000):
            bag.write(STATES.name, state, START + number, START)

    words = r"cannot write .*/bag_0.mcap: .*make room, then run: bag_recorder --recover .*/bag$"
    with file_size_limit(300_000), pytest.raises(BagError, match=words):
        fill()
    with pytest.raises(BagError, match=words):
        bag.flush()  # although there is room again: a chunk is missing
    written = bag.contents.message_count
    bag.close()
    left = Bag(tmp_path / "bag")
    count = left.topics[STATES.name].count
    assert left.truncated
    assert left.warning.endswith("was not finished")  # it ends with a whole record
    assert 0 < written - count <= 64 * 1024 / len(state)
    assert mcap_of(tmp_path / "bag").stat().st_size > 300_000 - 80_000
    assert [m.log_time - START for m in left.read_raw()] == list(range(count))
    assert recover(tmp_path / "bag").messages == count


def test_a_full_disk_stops_recovery_without_loss(small_bag, tmp_path):
    killed = rewritten(tmp_path / "killed", mcap_of(small_bag).read_bytes()[:-40])
    before = mcap_of(killed).read_bytes()
    with file_size_limit(5000), pytest.raises(BagError, match="nothing was changed; make room"):
        recover(killed)
    assert [path.name for path in killed.iterdir()] == ["killed_0.mcap"]
    assert mcap_of(killed).read_bytes() == before
    assert "killed_recovered" not in [path.name for path in tmp_path.iterdir()]
    assert not list(tmp_path.glob(".recovering-*"))


# --- property tests: no deadline, for nothing here is about time -----------------------
anything = examples(100)


@anything
@given(data=st.data())
def test_a_bag_cut_at_any_byte_gives_all_of_the_chunks_before(data, small_bag, tmp_path_factory):
    whole = mcap_of(small_bag).read_bytes()
    size = data.draw(st.integers(8, len(whole) - 1))
    folder = rewritten(tmp_path_factory.mktemp("cut") / "bag", whole[:size])
    messages = list(Bag(small_bag).read_raw())
    found = list(Bag(folder).read_raw())
    assert found == messages[: len(found)]
    last = max((end for code, _, end in frames(whole) if code == CHUNK and end <= size), default=0)
    complete = whole[:last]
    assert len(found) == sum(message.data in complete for message in messages)
    data_end = next(end for code, _, end in frames(whole) if code == DATA_END)
    bag = Bag(folder)
    assert bag.truncated == (size < data_end)
    assert ("was not finished" in bag.warning) == bag.truncated
    assert bag.metadata["message_count"] == sum(info.count for info in bag.topics.values())
    assert bag.metadata["message_count"] == len(found)
    result = recover(folder)
    assert (result.messages, result.topics) == (len(found), len(bag.topics))
    whole_again = Bag(result.bag)
    assert (whole_again.truncated, whole_again.warning) == (False, "")
    assert list(whole_again.read_raw()) == found
    assert whole_again.parameters() == PARAMETERS or len(found) < 2
    with Reader(result.bag) as reader:
        assert reader.message_count == len(found)
        for connection in reader.connections:
            topic = STATES if connection.topic == STATES.name else DESCRIPTION
            assert connection.digest == topic.type_hash
    assert recover(result.bag).bag == result.bag


@anything
@given(data=st.data(), bit=st.integers(0, 7))
def test_a_flipped_bit_costs_messages_but_invents_none(data, bit, small_bag, tmp_path_factory):
    damaged = bytearray(mcap_of(small_bag).read_bytes())
    at = data.draw(st.integers(0, len(damaged) - 1))
    # The opcode of an index, which no checksum covers, can become that of a message.
    assume(damaged[at] != MESSAGE_INDEX)
    damaged[at] ^= 1 << bit
    folder = rewritten(tmp_path_factory.mktemp("flip") / "bag", bytes(damaged))
    if at < 8:
        with pytest.raises(BagError, match="expected an MCAP file"):
            Bag(folder)
        return
    originals = set(Bag(small_bag).read_raw())
    bag = Bag(folder)
    found = list(bag.read_raw())
    read_all(folder)
    assert set(found) <= originals
    assert len(found) == len(originals) or bag.warning
    result = recover(folder)
    assert result.messages == len(found)
    assert list(Bag(result.bag).read_raw()) == found
    assert recover(result.bag).bag == result.bag


@anything
@given(data=st.data())
def test_damaged_metadata_yaml_does_no_harm(data, small_bag, tmp_path_factory):
    folder = rewritten(tmp_path_factory.mktemp("yaml") / "bag", mcap_of(small_bag).read_bytes())
    text = bytearray((small_bag / "metadata.yaml").read_bytes())
    text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    (folder / "metadata.yaml").write_bytes(text)
    bag = Bag(folder)
    assert isinstance(bag.metadata, dict)
    assert len(list(bag.read_raw())) == 102
    assert Bag(recover(folder).bag).metadata["message_count"] == 102

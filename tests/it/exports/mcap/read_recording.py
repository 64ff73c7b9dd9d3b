"""Reads a recording with mcap and mcap-ros2-support, and with rosbags: its file and its folder. Every event is
compared with a reference, decoded here by Prophesee's description and by the package evt3. Prints what each reader found as JSON.

Usage: read_recording.py RECORDING.mcap EVENTS.npz
"""

import json
import struct
import sys
import zlib
from pathlib import Path

import evt3
import numpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


class Evt3:
    """EVT 3.0 by Prophesee's description of the format. A step down of the upper part of the time is an overflow."""

    def __init__(self):
        self.high, self.low, self.turns = None, 0, 0
        self.row, self.base, self.polarity = None, 0, 0
        self.events = []

    def decode(self, data):
        for (word,) in struct.iter_unpack("<H", data):
            kind, value = word >> 12, word & 0xFFF
            if kind == 0x0:
                self.row = value & 0x7FF
            elif kind == 0x2:
                self.add(value & 0x7FF, value >> 11)
            elif kind == 0x3:
                self.base, self.polarity = value & 0x7FF, value >> 11
            elif kind in (0x4, 0x5):
                pixels = 12 if kind == 0x4 else 8
                for bit in range(pixels):
                    if value >> bit & 1:
                        self.add(self.base + bit, self.polarity)
                self.base += pixels
            elif kind == 0x6:
                self.low = value
            elif kind == 0x8:
                if self.high is not None and value < self.high:
                    self.turns += 1
                self.high = value
            else:
                raise ValueError(f"a word of kind {kind:#x}")

    def add(self, x, polarity):
        time = (self.turns << 24) | (self.high << 12) | self.low
        self.events.append((time, x, self.row, polarity))


def mcap_messages(path):
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == sum(summary.statistics.channel_message_counts.values())
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            yield channel.topic, schema.name, message.log_time, decoded


def rosbags_messages(path):
    with AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            yield connection.topic, connection.msgtype, time, reader.deserialize(data, connection.msgtype)


def stamp_ns(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def numbers(time, place, rotation):
    return [time, [place.x, place.y, place.z, rotation.x, rotation.y, rotation.z, rotation.w]]


def report(messages, reference):
    words, size = [], None
    found = {"topics": {}, "images": [], "depths": [], "poses": [], "transforms": []}
    decoder, epoch = Evt3(), None
    for topic, kind, time, message in messages:
        # A number of messages for each topic.
        found["topics"].setdefault(topic, [kind, 0])[1] += 1
        if topic == "/event_camera/events":
            before = len(decoder.events)
            decoder.decode(bytes(message.events))
            words.append(bytes(message.events))
            size = {"sensor_width": message.width, "sensor_height": message.height}
            assert (message.encoding, message.time_base, bool(message.is_bigendian)) == ("evt3", 0, False)
            assert stamp_ns(message.header) == time
            if len(decoder.events) > before:
                epoch = epoch or time - decoder.events[before][0] * 1000
                # The stamp of a packet is the time of its first event, after the epoch.
                assert time == epoch + decoder.events[before][0] * 1000
        elif topic in ("/image/image_raw", "/depth"):
            data = bytes(message.data)
            assert len(data) == message.height * message.step
            key = "images" if topic != "/depth" else "depths"
            found[key].append([stamp_ns(message.header), zlib.crc32(data)])
        elif topic == "/image/camera_info":
            found["k"] = [float(value) for value in message.k]
        elif topic == "/pose":
            pose = message.pose
            found["poses"].append(numbers(stamp_ns(message.header), pose.position, pose.orientation))
        elif topic == "/tf":
            (one,) = message.transforms
            assert (one.header.frame_id, one.child_frame_id) == ("world", "camera")
            place = one.transform
            found["transforms"].append(numbers(stamp_ns(one.header), place.translation, place.rotation))
    events = numpy.array(decoder.events, dtype=numpy.int64)
    # Within a microsecond the file is in the order of the reference.
    wanted = numpy.stack([reference[name].astype(numpy.int64) for name in "txyp"], axis=1)
    assert events.shape == wanted.shape, (events.shape, wanted.shape)
    assert (events == wanted).all()
    theirs = evt3.decode_bytes(b"".join(words), **size)
    names = ["timestamp", "x", "y", "polarity"]
    theirs = numpy.stack([numpy.asarray(getattr(theirs, name)).astype(numpy.int64) for name in names], axis=1)
    assert theirs.shape == wanted.shape and (theirs == wanted).all()
    found["events"] = len(events)
    return found


def main(recording, events):
    reference = numpy.load(events)
    readers = {
        "mcap": mcap_messages(recording),
        "rosbags, file": rosbags_messages(recording),
        "rosbags, folder": rosbags_messages(recording.parent),
    }
    json.dump({name: report(messages, reference) for name, messages in readers.items()}, sys.stdout)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

"""Decodes frames by a DBC file with cantools and prints each as a line of JSON, with names for numbers that have one.

Usage: frames.py FILE.dbc ID#DATA...
"""

import json
import sys

import cantools

database = cantools.database.load_file(sys.argv[1])
for frame in sys.argv[2:]:
    number, data = frame.split("#")
    message = database.get_message_by_frame_id(int(number, 16))
    said = message.decode(bytes.fromhex(data))
    print(json.dumps({"name": message.name, "from": message.senders[0], **{name: value if isinstance(value, (int, float)) else str(value) for name, value in said.items()}}))

#!/usr/bin/env bash
# Cyclone DDS: take returns the samples key by key, and not in the order in which they were written.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cyclonedds==11.0.1
cat > "$folder/try.py" <<'PYTHON'
import time
from dataclasses import dataclass

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import key
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


@dataclass
class Reading(IdlStruct, typename="Reading"):
    robot: int
    key("robot")
    number: int


participant = DomainParticipant(77)
everything = Qos(Policy.History.KeepAll, Policy.Reliability.Reliable(10**9))
topic = Topic(participant, "readings", Reading)
reader = DataReader(participant, topic, qos=everything)
writer = DataWriter(participant, topic, qos=everything)
for number in range(6):
    writer.write(Reading(number % 2, number))
time.sleep(2)
print(*(reading.number for reading in reader.take(10)))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "cyclonedds 11.0.1: one writer and one reader, keep all, reliable; six numbers written in turn for robot 0 and robot 1"
echo "guess: 0 1 2 3 4 5"
echo "seen:  0 2 4, then 1 3 5"
printf '0 2 4 1 3 5\n' | cmp - "$folder/seen"

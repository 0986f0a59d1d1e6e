#!/usr/bin/env bash
# HELICS: a vector that is read as a number is its Euclidean length, and no error or first element.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet helics==3.6.1
cat > "$folder/try.py" <<'PYTHON'
import helics

info = helics.helicsCreateFederateInfo()
info.core_type = "inproc"
info.core_init = "--federates=1 --autobroker"
info.property[helics.HELICS_PROPERTY_TIME_PERIOD] = 1.0
federate = helics.helicsCreateValueFederate("arm", info)
published = federate.register_global_publication("position", helics.HELICS_DATA_TYPE_VECTOR)
read = federate.register_subscription("position")
federate.enter_executing_mode()
published.publish([3.0, -4.0])
federate.request_time(1.0)
print(read.double, read.integer, read.vector)
federate.disconnect()
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "HELICS 3.6.1 (the Python package helics)"
echo "guess: [3, -4] read as a double is an error, or 3"
echo "seen:  5"
printf '5.0 5 [3.0, -4.0]\n' | cmp - "$folder/seen"

#!/usr/bin/env bash
# HELICS: a federate that asks for the time it has is granted the next one; asking again is no way to stay.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet helics==3.6.1
cat > "$folder/try.py" <<'PYTHON'
import helics

information = helics.helicsCreateFederateInfo()
helics.helicsFederateInfoSetCoreTypeFromString(information, "inproc")
helics.helicsFederateInfoSetCoreInitString(information, "-f 1 --autobroker")
federate = helics.helicsCreateValueFederate("one", information)
helics.helicsFederateSetTimeProperty(federate, helics.helics_property_time_period, 1.0)
helics.helicsFederateEnterExecutingMode(federate)
with open("granted", "w") as file:
    print(*(f"{helics.helicsFederateRequestTime(federate, time):.0f}" for time in (1, 1, 0.5)), file=file)
helics.helicsFederateFinalize(federate)
PYTHON
(cd "$folder" && venv/bin/python try.py >said 2>&1)
cp "$folder/granted" "$folder/seen"
cat "$folder/seen"
echo "helics 3.6.1: one federate with a period of 1 s asks for 1, 1 and 0.5"
echo "guess: 1, 1 and 1, or an error for the past"
echo "seen:  1, 2 and 3"
printf '1 2 3\n' | cmp - "$folder/seen"

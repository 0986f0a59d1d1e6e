#!/usr/bin/env bash
# One AprilTag, two detectors: OpenCV and pupil-apriltags agree on its number and are half a turn apart about which corner is the first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet opencv-contrib-python-headless==5.0.0.93 pupil-apriltags==1.0.4.post11
cat > "$folder/try.py" <<'PYTHON'
import cv2
import numpy as np
import pupil_apriltags

tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
image = np.full((320, 320), 255, np.uint8)
image[80:240, 80:240] = cv2.aruco.generateImageMarker(tags, 7, 160)


def names(corners):
    return ", ".join(("top" if y < 160 else "bottom") + " " + ("left" if x < 160 else "right") for x, y in corners)


corners, numbers, _ = cv2.aruco.ArucoDetector(tags).detectMarkers(image)
print(f"opencv {int(np.ravel(numbers)[0])}: {names(corners[0][0])}")
(tag,) = pupil_apriltags.Detector(families="tag36h11").detect(image)
print(f"pupil-apriltags {tag.tag_id}: {names(tag.corners)}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "OpenCV 5.0.0 (DICT_APRILTAG_36h11) and pupil-apriltags 1.0.4.post11: an upright tag that OpenCV has drawn"
echo "guess: the same corners, perhaps in the other direction from the same one"
echo "seen:  OpenCV starts top left; pupil-apriltags lists counterclockwise from the bottom left of a tag, and that is top right here"
printf 'opencv 7: top left, top right, bottom right, bottom left\npupil-apriltags 7: top right, top left, bottom left, bottom right\n' | cmp - "$folder/seen"

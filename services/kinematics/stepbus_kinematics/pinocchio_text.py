"""URDFs as Pinocchio reads them."""

from pathlib import Path
from xml.etree import ElementTree as ET

from stepbus_participant import package_path, parse_urdf


def pinocchio_text(text: str, folder: Path | None = None) -> str:
    """Return a checked URDF in which Pinocchio finds all shapes.

    Its parser of XML drops capsules, with a complaint; Pinocchio has them as cylinders that it is
    told are capsules. It searches meshes in the folder of the process only. folder: of the model;
    None: its meshes are not needed. Raises WiringError where there is no such package.
    """
    if "<capsule" not in text and folder is None:
        return text
    root = parse_urdf(text)
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            for capsule in shape.iterfind("geometry/capsule"):
                capsule.tag = "cylinder"
                if shape.tag == "collision":
                    _mark_capsule(link, shape)
    if folder is not None:
        for mesh in root.iter("mesh"):
            mesh.set("filename", _mesh_file(mesh.get("filename", ""), folder))
    return ET.tostring(root, encoding="unicode")


def _mesh_file(name: str, folder: Path) -> str:
    if name.startswith("package://"):
        return str(package_path(name, folder))
    path = (folder / name).absolute()
    return str(path) if path.is_file() else name


def _mark_capsule(link: ET.Element, shape: ET.Element) -> None:
    """Tell Pinocchio that a cylinder of a link is a capsule."""
    marks = link.find("collision_checking")
    if marks is None:
        marks = ET.SubElement(link, "collision_checking")
    names = {other.get("name") for other in link.findall("collision") if other is not shape}
    name = shape.get("name") or "capsule"
    while name in names:
        name += "_"
    shape.set("name", name)
    ET.SubElement(marks, "capsule", {"name": name})

"""The module gpio-sim for the guest's kernel. Debian's kernel is built without it, so it is built here, once, of Debian's
own source (GPL, nothing of it is kept in this repository): gpio-sim.c, and irq_sim.c of the kernel itself, which is not in
that kernel either. The result is kept beside the kernel in the cache.
"""
import os
import pathlib
import re
import shutil
import subprocess
import tarfile
import tempfile

import kernel

SOURCES = ("drivers/gpio/gpio-sim.c", "drivers/gpio/gpiolib.h", "kernel/irq/irq_sim.c")
MAKEFILE = "obj-m := gpio-sim-rig.o\ngpio-sim-rig-y := gpio-sim.o irq_sim.o\n"


def packages(image):
    """Those that a module for the kernel of this image package is built of."""
    release = image.removeprefix("linux-image-")
    abi = release.removesuffix("-rt-amd64")
    policy = kernel.command("apt-cache", "show", f"{image}")
    version = re.search(r"^Version: (\S+)$", policy, re.M)
    if not version:
        raise kernel.NotHere(f"apt knows no version of {image}")
    return release, [f"linux-headers-{release}", f"linux-headers-{abi}-common-rt", f"linux-kbuild-{abi}",
                     f"linux-source-6.12={version.group(1)}"]


def take_sources(package, into):
    """The three files of the archive of the whole source that is in linux-source."""
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL) as pipe:
        with tarfile.open(fileobj=pipe.stdout, mode="r|") as outer:
            for member in outer:
                if member.name.endswith(".tar.xz"):
                    left = set(SOURCES)
                    with tarfile.open(fileobj=outer.extractfile(member), mode="r|xz") as inner:
                        for file in inner:
                            name = file.name.split("/", 1)[-1]
                            if name in left:
                                (into / os.path.basename(name)).write_bytes(inner.extractfile(file).read())
                                left.discard(name)
                            if not left:
                                break
                    if left:
                        raise kernel.NotHere(f"{package} has no {sorted(left)[0]}")
                    pipe.kill()
                    return
    raise kernel.NotHere(f"{package} has no source in it")


def make_buildable(source):
    """irq_sim.c is part of the kernel, where it may call what modules may not."""
    path = source / "irq_sim.c"
    text = re.sub(r"^EXPORT_SYMBOL_GPL\(.*\n", "", path.read_text(), flags=re.M)
    path.write_text(text.replace("irq_to_desc(irqnum)", "irq_data_to_desc(irq_get_irq_data(irqnum))"))
    (source / "Makefile").write_text(MAKEFILE)


def build(image, work):
    release, wanted = packages(image)
    kernel.command("apt-get", "download", *wanted, cwd=work)
    source = work / "source"
    source.mkdir()
    for package in sorted(work.glob("*.deb")):
        if package.name.startswith("linux-source"):
            take_sources(str(package), source)
        else:
            kernel.command("dpkg-deb", "-x", str(package), str(work))
    make_buildable(source)
    headers = work / "usr" / "src" / f"linux-headers-{release}"
    makefile = headers / "Makefile"
    makefile.write_text(makefile.read_text().replace("/usr/", f"{work}/usr/"))
    kernel.command("make", "-C", str(headers), f"M={source}", "CONFIG_DEBUG_INFO_BTF_MODULES=", "modules")
    kernel.command("strip", "-g", str(source / "gpio-sim-rig.ko"))
    return source / "gpio-sim-rig.ko"


def get(folder):
    """[(name, bytes)], as kernel.load_order(). Raises NotHere."""
    folder = pathlib.Path(folder)
    kept = folder / "gpio-sim-rig.ko"
    if not kept.exists():
        with tempfile.TemporaryDirectory(dir=folder) as name:
            work = pathlib.Path(name)
            os.chmod(work, 0o755)
            made = build(folder.name, work)
            shutil.copyfile(made, work / "ready")
            (work / "ready").rename(kept)
    return [("gpio_sim", kept.read_bytes())]

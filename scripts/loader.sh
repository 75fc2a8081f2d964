#!/bin/sh
# SPDX-License-Identifier: MIT
# loader.sh FOLDER: libpellucid was installed in FOLDER, or removed from there. Where the dynamic loader searches there, its cache is
# rebuilt, which only root can; where it does not, programs that are linked to the library need its path, so this says how.
set -eu

PATH=$PATH:/usr/sbin:/sbin
folder=$1
command -v ldconfig >/dev/null || exit 0
if ldconfig -N -X -v 2>/dev/null | grep -q "^$folder:"; then
    if [ "$(id -u)" = 0 ]; then
        ldconfig
    elif [ -e "$folder/libpellucid.so" ]; then
        echo "The loader finds $folder/libpellucid.so.0 after: sudo ldconfig"
    fi
elif [ -e "$folder/libpellucid.so" ]; then
    echo "The loader does not look into $folder: programs that you link to the library need -Wl,-rpath,$folder or LD_LIBRARY_PATH=$folder"
fi

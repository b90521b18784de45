#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# Bake once, where the extension is; render ranges wherever a plain Blender 5 is.
# The scene's glasses must be in shading Displaced: shading True cannot be baked.
#   examples/farm.sh SCENE.blend FIRST LAST FRAMES_A_JOB
# Here the jobs run one after the other; a farm (Flamenco, say) would take the lines that are printed
# before each. The folder beside baked.blend must travel with it.
set -eu
scene=$1 first=$2 last=$3 size=$4
blender=${BLENDER:-blender}

"$blender" --command refractive_glass bake "$scene" -o baked.blend --frames "$first-$last"

start=$first
while [ "$start" -le "$last" ]; do
  end=$((start + size - 1))
  [ "$end" -le "$last" ] || end=$last
  echo "$blender -b baked.blend -s $start -e $end -a"
  "$blender" -b baked.blend -s "$start" -e "$end" -a
  start=$((end + 1))
done

#!/bin/bash
# SPDX-License-Identifier: GPL-3.0-or-later
#SBATCH --job-name=label
#SBATCH --array=0-99%20
#SBATCH --cpus-per-task=1
#SBATCH --mem=2G
#SBATCH --requeue
#SBATCH --output=label-%A-%a.log
# sbatch slurm-label.sh TAKES.TXT --model MODEL --out DIR ...: each job of the array labels every so manieth take.
set -euo pipefail
read -ra program <<< "${MOCAP_AUTOLABEL:-blender --background --command mocap_autolabel}"
mapfile -t takes < "$1"
mine=()
for ((i = SLURM_ARRAY_TASK_ID - SLURM_ARRAY_TASK_MIN; i < ${#takes[@]}; i += SLURM_ARRAY_TASK_COUNT)); do
  mine+=("${takes[i]}")
done
((${#mine[@]})) || exit 0
# What a job that was requeued has done already is passed over.
exec "${program[@]}" label "${mine[@]}" --resume "${@:2}"

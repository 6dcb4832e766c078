// SPDX-License-Identifier: GPL-3.0-or-later

const JOB_TYPE = {
    label: "Label Takes",
    description: "Name the markers of motion capture takes with Mocap Autolabel",
    settings: [
        { key: "folder", type: "string", subtype: "dir_path", default: "//takes", visible: "submission",
          description: "Folder of the takes" },
        { key: "pattern", type: "string", default: "*.c3d", visible: "submission",
          description: "Which files there are takes" },
        { key: "takes", type: "string", required: true,
          eval: "';'.join(map(str, sorted(Path(bpy.path.abspath(settings.folder)).glob(settings.pattern))))",
          evalInfo: { showLinkButton: true, description: "All that are in the folder" },
          description: "The takes, with a ; between them" },
        { key: "model", type: "string", required: true,
          description: "A built-in model or the path of a .markerset.json file" },
        { key: "cameras", type: "string", subtype: "file_path", default: "",
          description: "Calibration, for takes of camera blobs" },
        { key: "out", type: "string", subtype: "dir_path", required: true, description: "Folder for the results" },
        { key: "html", type: "bool", default: true, description: "Also write a page about each take" },
        { key: "takes_per_task", type: "int32", default: 10, propargs: { min: 1 }, visible: "submission",
          description: "Takes that one task labels, one after the other" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const takes = settings.takes.split(";").map((take) => take.trim()).filter((take) => take);
    for (let first = 0; first < takes.length; first += settings.takes_per_task) {
        const some = takes.slice(first, first + settings.takes_per_task);
        const task = author.Task(`label-${first + 1}-${first + some.length}`, "blender");
        task.addCommand(author.Command("exec", { exe: "{blender}", args: labelArguments(settings, some) }));
        job.addTask(task);
    }
}

function labelArguments(settings, takes) {
    let words = ["--background", "--command", "mocap_autolabel", "label", ...takes];
    // What a task that is tried again has done already is passed over.
    words.push("--model", settings.model, "--out", settings.out, "--resume");
    if (settings.cameras) words.push("--cameras", settings.cameras);
    if (settings.html) words.push("--html");
    return words;
}

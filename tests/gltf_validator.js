// Prints, as JSON, what the Khronos validator reports of each file named: how often which code.
const fs = require("fs");
const path = require("path");
const validator = require("gltf-validator");

async function reported(file) {
  const beside = (uri) => path.join(path.dirname(file), decodeURIComponent(uri));
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
    uri: path.basename(file),
    maxIssues: 0,
    externalResourceFunction: async (uri) => new Uint8Array(fs.readFileSync(beside(uri))),
  });
  const counts = {};
  for (const { code } of report.issues.messages) counts[code] = (counts[code] || 0) + 1;
  return counts;
}

(async () => {
  const found = [];
  for (const file of process.argv.slice(2)) found.push(await reported(file));
  console.log(JSON.stringify(found));
})();

// Bundles the page: build.mjs --site FOLDER; with --tests the twin and the tests too, into run/.
import { build } from 'esbuild';
import { cpSync, mkdirSync } from 'node:fs';

const words = process.argv.slice(2);
const site = words[words.indexOf('--site') + 1];
const node = { bundle: true, platform: 'node', target: 'node18', format: 'esm',
  packages: 'external', logLevel: 'warning' };

mkdirSync(site, { recursive: true });
await build({ entryPoints: ['src/main.ts'], outfile: `${site}/page.js`, bundle: true,
  format: 'esm', target: 'es2022', minify: true, legalComments: 'external', logLevel: 'warning' });
for (const file of ['index.html', 'style.css', 'icon.svg']) cpSync(file, `${site}/${file}`);
if (words.includes('--tests')) {
  await build({ ...node, entryPoints: ['twin/twin_main.ts'], outfile: 'run/twin.mjs' });
  await build({ ...node, entryPoints: ['test/page_test.ts'], outfile: 'run/page_test.mjs' });
}

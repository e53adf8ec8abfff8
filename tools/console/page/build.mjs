// Bundles the page: build.mjs --site FOLDER; the twin, the tests, the bench's part in the browser,
// the film and the pictures go into run/.
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
const programs = { twin: 'twin/twin_main', page_test: 'test/page_test',
  real_test: 'test/real_test', boxes_test: 'test/boxes_test',
  firefox_test: 'test/firefox_test', measure: 'test/measure',
  film: 'test/film', pictures: 'test/pictures' };
for (const [name, file] of Object.entries(programs)) {
  await build({ ...node, entryPoints: [`${file}.ts`], outfile: `run/${name}.mjs` });
}

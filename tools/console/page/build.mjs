// Bundles the page into site/ and, with --tests, the twin and the tests into run/.
import { build } from 'esbuild';
import { cpSync, mkdirSync } from 'node:fs';

const node = { bundle: true, platform: 'node', target: 'node18', format: 'esm', packages: 'external',
  logLevel: 'warning' };

mkdirSync('site', { recursive: true });
await build({ entryPoints: ['src/main.ts'], outfile: 'site/page.js', bundle: true, format: 'esm',
  target: 'es2022', minify: true, legalComments: 'external', logLevel: 'warning' });
for (const file of ['index.html', 'style.css', 'icon.svg']) cpSync(file, `site/${file}`);
if (process.argv.includes('--tests')) {
  await build({ ...node, entryPoints: ['twin/twin_main.ts'], outfile: 'run/twin.mjs' });
  await build({ ...node, entryPoints: ['test/page_test.ts'], outfile: 'run/page_test.mjs' });
}

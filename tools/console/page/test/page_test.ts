// The page against a twin of the box, in a real browser: page_test.mjs SITE ARTEFACTS. Prints its
// seed; TELETACT_SEED repeats a run. 77: no browser here.
import { after, before, test } from 'node:test';
import { Browser, BrowserContext } from 'playwright-core';
import { TwinBox } from '../twin/box';
import { actTests } from './acts';
import { chromiumProgram, Desk, launch, seed, site } from './browser';
import { headsetTests } from './headset';
import { heldTests } from './held';
import { readerTests } from './readers';
import { sessionTests } from './sessions';

export interface Bench {
  browser: Browser;
  context: BrowserContext;
  twin: TwinBox;
  desk: Desk;
}

if (!chromiumProgram()) {
  console.log('skipped: no chromium (apt-get install chromium)');
  process.exit(77);
}
console.log(`seed ${seed}`);

const bench = {} as Bench;

before(async () => {
  bench.twin = new TwinBox(site, seed);
  await bench.twin.listen();
  bench.browser = await launch();
  bench.context = await bench.browser.newContext({ viewport: { width: 1280, height: 720 },
    colorScheme: 'dark' });
  bench.desk = await Desk.open(bench.context, bench.twin);
});

after(async () => {
  await bench.browser?.close();
  await bench.twin?.close();
});

test('views from the box', () => readerTests(seed));
test('held', t => heldTests(t));
test('acts', t => actTests(t, bench));
test('sessions', t => sessionTests(t, bench));
test('headset', t => headsetTests(t, bench));

// node twin.mjs SITE [PORT [SEED]]: the twin of the box alone, for a look at the page.
import { TwinBox } from './box';

const [site = 'site', port = '0', seed = '1'] = process.argv.slice(2);
console.log(await new TwinBox(site, Number(seed)).listen(Number(port)));

// A real OpenID Connect provider on loopback. POST /control says who logs in and with which roles, and may make
// it lie: "lie" changes claims of the next ID token, which is then signed by the provider's own key, or by none.

import { createServer } from "node:http";
import { Readable } from "node:stream";

import { SignJWT, decodeJwt, exportJWK, generateKeyPair } from "jose";
import Provider from "oidc-provider";

const { privateKey } = await generateKeyPair("RS256", { extractable: true });
const key = { ...(await exportJWK(privateKey)), kid: "k", alg: "RS256", use: "sig" };
let now = { account: "a1", roles: [], name: "Rosa", lie: {}, unsigned: false };

const server = createServer((request, response) => answer(request, response).catch((error) => response.destroy(error)));
server.listen(0, "127.0.0.1", () => process.stdout.write(`${server.address().port}\n`));
await new Promise((resolve) => server.once("listening", resolve));

const issuer = `http://127.0.0.1:${server.address().port}`;
const provider = new Provider(issuer, {
  clients: [{
    client_id: "acromion",
    client_secret: "a secret of the client that is long enough",
    redirect_uris: [process.argv[2]],
    grant_types: ["authorization_code"],
    response_types: ["code"],
  }],
  jwks: { keys: [key] },
  pkce: { required: () => true },
  conformIdTokenClaims: false,
  claims: { openid: ["sub"], profile: ["name", "roles"] },
  features: { devInteractions: { enabled: false } },
  interactions: { url: (_, { uid }) => `/interaction/${uid}` },
  findAccount: (_, accountId) => ({ accountId, claims: () => ({ sub: accountId, name: now.name, roles: now.roles }) }),
  cookies: { keys: ["only for tests"] },
});
const serve = provider.callback();

async function answer(request, response) {
  if (request.url === "/control") return control(request, response);
  if (request.url.startsWith("/interaction/")) return interact(request, response);
  if (request.url !== "/token") return serve(request, response);
  const end = response.end.bind(response);
  const pieces = [];
  response.write = (piece) => pieces.push(Buffer.from(piece));
  response.end = (piece) => {
    if (piece) pieces.push(Buffer.from(piece));
    change(Buffer.concat(pieces)).then((body) => {
      response.removeHeader("content-length");
      end(body);
    });
  };
  return serve(request, response);
}

async function control(request, response) {
  const told = Buffer.concat(await Readable.from(request).toArray()).toString();
  now = { account: "a1", roles: [], name: "Rosa", lie: {}, unsigned: false, ...JSON.parse(told) };
  response.end("{}");
}

async function interact(request, response) {
  const { prompt, params, session } = await provider.interactionDetails(request, response);
  if (prompt.name === "login") {
    return provider.interactionFinished(request, response, { login: { accountId: now.account } });
  }
  const grant = new provider.Grant({ accountId: session.accountId, clientId: params.client_id });
  grant.addOIDCScope("openid profile");
  return provider.interactionFinished(request, response, { consent: { grantId: await grant.save() } });
}

async function change(body) {
  const told = JSON.parse(body);
  if (!told.id_token || (!Object.keys(now.lie).length && !now.unsigned)) return body;
  const claims = { ...decodeJwt(told.id_token), ...now.lie };
  for (const [name, value] of Object.entries(claims)) if (value === null) delete claims[name];
  const code = (part) => Buffer.from(JSON.stringify(part)).toString("base64url");
  told.id_token = now.unsigned
    ? `${code({ alg: "none" })}.${code(claims)}.`
    : await new SignJWT(claims).setProtectedHeader({ alg: "RS256", kid: "k" }).sign(privateKey);
  return JSON.stringify(told);
}

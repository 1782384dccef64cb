// Rules for the script of the page of `gpszip view`; types are checked by tsc (tsconfig.json).
export default [
  {
    files: ["src/gpszip/view/assets/script/*.js"],
    languageOptions: { ecmaVersion: 2022, sourceType: "module" },
    rules: {
      eqeqeq: "error",
      "max-depth": ["error", 4],
      "max-lines": ["error", 500],
      "max-lines-per-function": ["error", 70],
      "no-eval": "error",
      "no-implied-eval": "error",
      "no-shadow": "error",
      "no-unused-vars": "error",
      "no-var": "error",
      "prefer-const": "error",
      "no-restricted-properties": [
        "error",
        { property: "innerHTML", message: "Text from data is set as text only: textContent." },
        { property: "outerHTML", message: "Text from data is set as text only: textContent." },
      ],
    },
  },
];
